/** German for the fixed texts of a report, which the service writes in English: effects, where to look, experiments. */
import type { Sentence } from "./sentences";

/** Effects, by what the report calls them. */
const EFFECTS: Record<string, string> = {
  "inertia of the drive itself": "Trägheit des Antriebs selbst",
  "friction that differs between extending and retracting": "Reibung, die beim Aus- und Einfahren verschieden ist",
  "friction that differs between the two directions": "Reibung, die in den beiden Richtungen verschieden ist",
  "play between piston and joint": "Spiel zwischen Kolben und Gelenk",
  "a base that is not level": "ein Sockel, der nicht waagerecht steht",
  "sloshing of a carried liquid": "Schwappen einer mitgeführten Flüssigkeit",
  "a counterbalance valve that throttles while lowering": "ein Senkbremsventil, das beim Senken drosselt",
  "another cylinder's flow acting on this one's pressures":
    "Volumenstrom eines anderen Zylinders, der auf die Drücke dieses Zylinders wirkt",
  "a joint encoder that runs eccentrically": "ein Winkelgeber, der exzentrisch läuft",
  "a joint encoder whose zero is off": "ein Winkelgeber mit verschobenem Nullpunkt",
  "an end-of-stroke cushion": "eine Endlagendämpfung",
  "a gas spring or trapped accumulator": "eine Gasfeder oder ein eingeschlossener Speicher",
  "hoses or harness that act as a spring": "Schläuche oder Kabelbaum, die wie eine Feder wirken",
  "a linkage pin that is not where the machine file says":
    "ein Bolzen der Koppelkinematik, der nicht dort sitzt, wo die Maschinendatei sagt",
  "friction that grows with the load": "Reibung, die mit der Last wächst",
  "a lubricating film that lags behind the speed": "ein Schmierfilm, der der Geschwindigkeit nachläuft",
  "a payload in part of the recordings": "eine Nutzlast in einem Teil der Aufzeichnungen",
  "friction that follows another joint's pose": "Reibung, die von der Stellung eines anderen Gelenks abhängt",
  "friction that depends on the piston position": "Reibung, die vom Kolbenweg abhängt",
  "friction that depends on the joint position": "Reibung, die von der Gelenkstellung abhängt",
  "a force that is periodic in position": "eine Kraft, die sich periodisch mit dem Weg ändert",
  "an effort that is periodic in position": "ein Moment, das sich periodisch mit der Stellung ändert",
  "friction that builds up over a distance after a reversal":
    "Reibung, die sich nach einer Umkehr über einen Weg aufbaut",
  "friction that grows with the chamber pressure": "Reibung, die mit dem Kammerdruck wächst",
  "a drifting pressure sensor": "ein driftender Druckaufnehmer",
  "a drifting effort sensor": "ein driftender Kraft- oder Momentaufnehmer",
  "a wrong gain of a pressure sensor": "eine falsche Empfindlichkeit eines Druckaufnehmers",
  "an offset of a pressure sensor": "ein Nullpunktfehler eines Druckaufnehmers",
  "an offset of the effort sensor": "ein Nullpunktfehler des Kraft- oder Momentaufnehmers",
  "a flow loss that grows with the square of the speed":
    "ein Strömungsverlust, der mit dem Quadrat der Geschwindigkeit wächst",
  "a drag that grows with the square of the speed": "ein Widerstand, der mit dem Quadrat der Geschwindigkeit wächst",
  "delayed effort signals": "verzögerte Kraftsignale",
  "extra friction at low speed (Stribeck)": "zusätzliche Reibung bei kleiner Geschwindigkeit (Stribeck-Reibung)",
  "a structure that bends behind the joint": "ein Tragwerk, das hinter dem Gelenk nachgibt",
  "a ripple of the supply pressure": "eine Pulsation des Versorgungsdrucks",
  "viscous friction that drifts as the oil warms up": "viskose Reibung, die mit der Erwärmung des Öls driftet",
  "viscous friction that drifts as the drive warms up": "viskose Reibung, die mit der Erwärmung des Antriebs driftet",
  "power-law friction": "Reibung nach einem Potenzgesetz",
};

/** Which part of the machine to look at. */
const LOOK_AT: Record<string, string> = {
  "nothing is broken: the drive's own inertia belongs into the model":
    "nichts ist defekt: Die Trägheit des Antriebs gehört in das Modell",
  "rod and piston seals of the cylinder, and the zero of its two pressure sensors":
    "Stangen- und Kolbendichtungen des Zylinders und der Nullpunkt seiner beiden Druckaufnehmer",
  "gear and bearings of the joint, and the zero of its effort sensor":
    "Getriebe und Lager des Gelenks und der Nullpunkt seines Kraft- oder Momentaufnehmers",
  "pins, bushings and gear between piston and joint: measure the play by hand":
    "Bolzen, Buchsen und Getriebe zwischen Kolben und Gelenk: das Spiel von Hand messen",
  "bearings, coupling and gear between motor and joint: measure the play by hand":
    "Lager, Kupplung und Getriebe zwischen Motor und Gelenk: das Spiel von Hand messen",
  "the base: level it, or write its tilt into the machine file":
    "der Sockel: waagerecht ausrichten oder seine Neigung in die Maschinendatei schreiben",
  "what the joint carries: a tank or bucket that is partly filled":
    "was das Gelenk trägt: ein teilweise gefüllter Tank oder Löffel",
  "the load-holding valve: its setting, and on which side of it the pressure is measured":
    "das Lasthalteventil: seine Einstellung, und auf welcher Seite davon der Druck gemessen wird",
  "the return line that both cylinders share: hose bore, filter, back-pressure":
    "die gemeinsame Rücklaufleitung beider Zylinder: Schlauchquerschnitt, Filter, Staudruck",
  "how the joint encoder is mounted: its disc or shaft is not centred":
    "die Montage des Winkelgebers: Scheibe oder Welle sitzt nicht zentrisch",
  "the zero of the joint encoder: set it again at a mechanical mark":
    "der Nullpunkt des Winkelgebers: an einer mechanischen Marke neu setzen",
  "the cushion at that end of the cylinder: its screw and its seal":
    "die Endlagendämpfung an diesem Ende des Zylinders: Drosselschraube und Dichtung",
  "gas in the chamber or an accumulator on the line: bleed the cylinder, check the accumulator":
    "Gas in der Kammer oder ein Speicher an der Leitung: Zylinder entlüften, Speicher prüfen",
  "hoses and cable harness across the joint: how they are led and where they are clamped":
    "Schläuche und Kabelbaum über das Gelenk: wie sie geführt und wo sie befestigt sind",
  "the lengths of the linkage in the machine file against the drawing, and worn or wrongly set pins":
    "die Längen der Koppelkinematik in der Maschinendatei gegen die Zeichnung, und verschlissene oder falsch gesetzte Bolzen",
  "seals and bearings of the cylinder and its pins: lubrication and wear under load":
    "Dichtungen und Lager des Zylinders und seiner Bolzen: Schmierung und Verschleiß unter Last",
  "gear and bearings of the joint: lubrication and wear under load":
    "Getriebe und Lager des Gelenks: Schmierung und Verschleiß unter Last",
  "seals and guide of the cylinder, and the oil's viscosity":
    "Dichtungen und Führung des Zylinders und die Viskosität des Öls",
  "gear and bearings of the joint, and the viscosity of their grease":
    "Getriebe und Lager des Gelenks und die Viskosität ihres Fetts",
  "what the arm carries at its tip: take it off, or tell the model its mass":
    "was der Arm an der Spitze trägt: abnehmen oder dem Modell seine Masse angeben",
  "the joint's bearing and what bends it in that pose": "das Lager des Gelenks und was es in dieser Stellung verspannt",
  "bore, rod and guide of the cylinder where friction is high: a worn rod, a bore that is not round":
    "Rohr, Stange und Führung des Zylinders, wo die Reibung hoch ist: eine verschlissene Stange, ein unrundes Rohr",
  "gear and guide of the joint where friction is high: wear, or parts that are not round":
    "Getriebe und Führung des Gelenks, wo die Reibung hoch ist: Verschleiß oder unrunde Teile",
  "screw, gear or rod surface: count its teeth or its pitch against the period that was found":
    "Spindel, Getriebe oder Stangenoberfläche: Zähne oder Steigung mit der gefundenen Periode vergleichen",
  "screw or gear: count its teeth or its pitch against the period that was found":
    "Spindel oder Getriebe: Zähne oder Steigung mit der gefundenen Periode vergleichen",
  "seals of the cylinder: their preload; it is usual and only has to be modelled":
    "Dichtungen des Zylinders: ihre Vorspannung; das ist üblich und muss nur modelliert werden",
  "gear and bearings of the joint: their preload; it is usual and only has to be modelled":
    "Getriebe und Lager des Gelenks: ihre Vorspannung; das ist üblich und muss nur modelliert werden",
  "seals of the cylinder that chamber pressure presses: type and wear":
    "Dichtungen des Zylinders, die der Kammerdruck anpresst: Bauart und Verschleiß",
  "gear and bearings of the joint: wear": "Getriebe und Lager des Gelenks: Verschleiß",
  "the pressure sensor and its temperature: warm up first, replace it if it goes on":
    "der Druckaufnehmer und seine Temperatur: erst warmlaufen lassen, tauschen, wenn es anhält",
  "the effort sensor and its temperature: warm up first, replace it if it goes on":
    "der Kraft- oder Momentaufnehmer und seine Temperatur: erst warmlaufen lassen, tauschen, wenn es anhält",
  "the pressure sensor's range and scale in the machine file, then the sensor itself":
    "Messbereich und Skalierung des Druckaufnehmers in der Maschinendatei, dann der Aufnehmer selbst",
  "the effort sensor's range and scale in the machine file, then the sensor itself":
    "Messbereich und Skalierung des Kraft- oder Momentaufnehmers in der Maschinendatei, dann der Aufnehmer selbst",
  "the pressure sensor's zero: vent both chambers and set it":
    "der Nullpunkt des Druckaufnehmers: beide Kammern entlüften und ihn setzen",
  "the effort sensor's zero: take the load off and set it":
    "der Nullpunkt des Kraft- oder Momentaufnehmers: die Last abnehmen und ihn setzen",
  "port, fittings and hose between pressure sensor and chamber: a throttle, or a sensor far from the port":
    "Anschluss, Verschraubungen und Schlauch zwischen Druckaufnehmer und Kammer: eine Drosselstelle oder ein Aufnehmer weit vom Anschluss",
  "gear and bearings of the joint: what grows with the square of the speed, as stirred grease":
    "Getriebe und Lager des Gelenks: was mit dem Quadrat der Geschwindigkeit wächst, wie gewalktes Fett",
  "filters and update rates of sensors and nodes: who sends the pressures later than the positions":
    "Filter und Aktualisierungsraten von Sensoren und Knoten: wer die Drücke später sendet als die Stellungen",
  "seals and lubrication of the cylinder at low speed":
    "Dichtungen und Schmierung des Zylinders bei kleiner Geschwindigkeit",
  "gear and bearings of the joint: lubrication at low speed":
    "Getriebe und Lager des Gelenks: Schmierung bei kleiner Geschwindigkeit",
  "the link behind the joint: cracks, loose bolts, a boom that gives way":
    "das Glied hinter dem Gelenk: Risse, lose Schrauben, ein nachgebender Ausleger",
  "the pump and its accumulator: worn elements, lost gas charge":
    "die Pumpe und ihr Speicher: verschlissene Elemente, verlorene Gasfüllung",
  "the oil: warm the machine up before recordings, or add an oil temperature sensor":
    "das Öl: die Maschine vor Aufzeichnungen warmfahren oder einen Öltemperaturfühler ergänzen",
  "the grease: warm the machine up before recordings": "das Fett: die Maschine vor Aufzeichnungen warmfahren",
  "nothing is broken: this seal has another friction curve than the base model":
    "nichts ist defekt: Diese Dichtung hat eine andere Reibungskennlinie als das Grundmodell",
};

/** What tells causes apart, and what else would. */
const EXPERIMENTS: Record<string, string> = {
  "report it lumped with the link": "zusammen mit dem Glied angeben",
  "an offset is also there at rest: hold the arm still at both ends of a stroke":
    "ein Nullpunktfehler ist auch in Ruhe da: den Arm an beiden Enden eines Hubs still halten",
  "an offset is also there at rest: hold the arm still at both ends of its range":
    "ein Nullpunktfehler ist auch in Ruhe da: den Arm an beiden Enden seines Bereichs still halten",
  "move slowly through zero load in both directions": "in beiden Richtungen langsam durch die Last null fahren",
  "an inclinometer on the base, or the same motion after half a slew turn":
    "ein Neigungsmesser am Sockel, oder dieselbe Bewegung nach einer halben Schwenkung",
  "record the ring-down after a stop": "das Ausschwingen nach einem Halt aufzeichnen",
  "move the sensor to the cylinder port": "den Aufnehmer an den Zylinderanschluss versetzen",
  "move the neighbour alone": "das Nachbargelenk allein bewegen",
  "compare joint and piston encoder over the whole stroke; no dynamics needed":
    "Gelenk- und Kolbengeber über den ganzen Hub vergleichen; ohne Dynamik",
  "compare with a second encoder over the whole range; no dynamics needed":
    "mit einem zweiten Geber über den ganzen Bereich vergleichen; ohne Dynamik",
  "drive the joint to a mechanical zero and read the encoder":
    "das Gelenk auf einen mechanischen Nullpunkt fahren und den Geber ablesen",
  "dwell inside the cushion": "in der Endlagendämpfung verweilen",
  "isolate the accumulator": "den Speicher absperren",
  "take the harness off and repeat": "den Kabelbaum abnehmen und wiederholen",
  "compare piston position and joint angle over the whole stroke":
    "Kolbenweg und Gelenkwinkel über den ganzen Hub vergleichen",
  "the same stroke with two loads": "derselbe Hub mit zwei Lasten",
  "the same motion with two loads": "dieselbe Bewegung mit zwei Lasten",
  "one amplitude at three frequencies": "eine Amplitude bei drei Frequenzen",
  "an empty and a loaded run": "ein leerer und ein beladener Lauf",
  "a single joint at three poses of the other": "ein einzelnes Gelenk bei drei Stellungen des anderen",
  "move other joints so that load and position decorrelate":
    "andere Gelenke so bewegen, dass Last und Stellung nicht mehr zusammenhängen",
  "change the speed: a harmonic stays in x, a ripple in t":
    "die Geschwindigkeit ändern: Eine Harmonische bleibt im Weg, eine Pulsation in der Zeit",
  "slow reversals at three rates: presliding depends on distance, a delay on time":
    "langsame Umkehrungen mit drei Raten: Vorgleiten hängt vom Weg ab, eine Verzögerung von der Zeit",
  "change the back-pressure at constant load": "den Staudruck bei gleicher Last ändern",
  "take the first pose again at the end": "am Ende noch einmal die erste Stellung einnehmen",
  "a known mass, or both ports joined": "eine bekannte Masse, oder beide Anschlüsse verbinden",
  "vent both chambers and read the sensors": "beide Kammern entlüften und die Aufnehmer ablesen",
  "take the load off and read the sensor": "die Last abnehmen und den Aufnehmer ablesen",
  "fast strokes; move the sensor to the port": "schnelle Hübe; den Aufnehmer an den Anschluss versetzen",
  "fast motions": "schnelle Bewegungen",
  "move at two frequencies: the phase of a delay grows with frequency":
    "mit zwei Frequenzen bewegen: Die Phase einer Verzögerung wächst mit der Frequenz",
  "a staircase of constant speeds below 5 mm/s": "eine Treppe konstanter Geschwindigkeiten unter 5 mm/s",
  "a staircase of slow constant speeds": "eine Treppe langsamer konstanter Geschwindigkeiten",
  "a tap test: hit the boom and look for the resonance":
    "ein Klopfversuch: den Ausleger anschlagen und die Resonanz suchen",
  "change the pump's speed: the line moves with it": "die Pumpendrehzahl ändern: Die Linie wandert mit",
  "the same cycle cold and warm": "derselbe Zyklus kalt und warm",
  "a staircase of constant speeds": "eine Treppe konstanter Geschwindigkeiten",
  "the training motion once more": "die Anregungsbewegung noch einmal",
  "a motion of all joints that was designed to tell them apart":
    "eine Bewegung aller Gelenke, die entworfen wurde, um sie zu unterscheiden",
};

/** Signals that an error is drawn over or follows. */
const SIGNALS: Record<string, string> = {
  time: "Zeit",
  "piston position": "Kolbenweg",
  "piston speed": "Kolbengeschwindigkeit",
  "piston acceleration": "Kolbenbeschleunigung",
  "joint position": "Gelenkstellung",
  "joint speed": "Gelenkgeschwindigkeit",
  "joint acceleration": "Gelenkbeschleunigung",
  "joint effort": "Gelenkmoment",
  "effort rate": "Änderungsrate der Kraft",
  "force rate": "Änderungsrate der Kraft",
  "cylinder force": "Zylinderkraft",
  "head pressure": "Druck kolbenseitig",
  "rod pressure": "Druck stangenseitig",
  "supply pressure": "Versorgungsdruck",
  "tank pressure": "Tankdruck",
  "oil temperature": "Öltemperatur",
};

/** Why a cause was not accepted, and motions, with names and numbers in them: `(...)` stands for `$1`, `$2`, ... */
export const REPORT_SENTENCES: Sentence[] = [
  [/^gains (.+) of chi-square for (\d+) parameters?$/, "verbessert Chi-Quadrat um $1 mit $2 Parametern"],
  [
    /^(.+): a small structure in (.+) is left \(chi-square (.+)\); the added effect does not describe it completely$/,
    "$1: Eine kleine Struktur bleibt übrig ($2; Chi-Quadrat $3); der ergänzte Effekt beschreibt sie nicht vollständig",
  ],
  [
    /^(.+) have a standard deviation above (.+) % of the value: they are poorly determined by these recordings$/,
    "$1: Standardabweichung über $2 % des Werts; diese Aufzeichnungen bestimmen sie schlecht",
  ],
  [
    /^no validation motion: errors are those of the training motion, which was fitted$/,
    "keine Validierungsbewegung: Die Fehler sind die der Anregungsbewegung, an die angepasst wurde",
  ],
  [
    /^no repeated motion: the noise floor is an estimate from residuals; record the training motion twice$/,
    "keine Wiederholung: Der Rauschpegel ist aus Residuen geschätzt; zeichnen Sie die Anregungsbewegung zweimal auf",
  ],
  [
    /^friction was estimated with the arm attached on (.+): no unloaded recording of it$/,
    "die Reibung von $1 wurde mit angehängtem Arm geschätzt: keine Aufzeichnung mit ausgehängter Kolbenstange",
  ],
  [
    /^(.+) never moved: nothing is known of its friction and stiffness$/,
    "$1 hat sich nie bewegt: Über Reibung und Steifigkeit ist nichts bekannt",
  ],
  [/^this motion cannot tell (.+); they are left at zero$/, "diese Bewegung bestimmt $1 nicht; sie bleiben null"],
  [
    /^fits all samples worse than (.+): chi-square higher by (.+)$/,
    "passt schlechter zu allen Werten als $1: Chi-Quadrat um $2 höher",
  ],
  [
    /^gains (.+) of chi-square, which chance or what was found explains as well$/,
    "verbessert Chi-Quadrat um $1; das erklärt auch der Zufall oder was schon gefunden wurde",
  ],
  [
    /^significant, but another effect explains the same better$/,
    "signifikant, aber ein anderer Effekt erklärt dasselbe besser",
  ],
  [/^not needed beside what was found later$/, "neben dem später Gefundenen nicht nötig"],
  [
    /^another joint certainly lacks something, and with that it gains nothing$/,
    "an einem anderen Gelenk fehlt sicher etwas, und damit bringt es nichts",
  ],
  [
    /^it makes (.+) worse on the validation motion \(error (.+) %\)$/,
    "es verschlechtert $1 auf der Validierungsbewegung (Fehler $2 %)",
  ],
  [
    /^it does not hold on blocks that were left out of the fit \(chi-square (.+), (.+) standard errors\)$/,
    "es hält auf Abschnitten, an die nicht angepasst wurde, nicht stand (Chi-Quadrat $1, $2 Standardfehler)",
  ],
  [
    /^it does not help on the validation motion \(chi-square (.+)\)$/,
    "es hilft auf der Validierungsbewegung nicht (Chi-Quadrat $1)",
  ],
  [
    /^it acts in one recording only, and is not significant enough to be believed without another$/,
    "es wirkt nur in einer Aufzeichnung und ist nicht signifikant genug, um ohne eine zweite geglaubt zu werden",
  ],
  [
    /^the rows that show it are (.+) times as noisy as the motion as a whole; against that it gains (.+) of chi-square, less than the noise and its price ask for$/,
    "die Zeilen, die es zeigen, rauschen $1-mal so stark wie die ganze Bewegung; dagegen verbessert es Chi-Quadrat um $2, weniger als Rauschen und Aufwand verlangen",
  ],
  [/^it changes with the filter: (.+)$/, "es ändert sich mit dem Filter: $1"],
  [
    /^what it could not be told apart from is not confirmed by the efforts on the validation motion$/,
    "wovon es nicht zu unterscheiden war, wird von den Kräften auf der Validierungsbewegung nicht bestätigt",
  ],
  [
    /^with it the friction of (.+) would drive the motion at (.+) of speed \((.+)\)$/,
    "damit würde die Reibung von $1 die Bewegung bei Geschwindigkeit $2 antreiben ($3)",
  ],
  [
    /^a staircase of constant speeds of (.+), out and back at each; the other joints hold$/,
    "eine Treppe konstanter Geschwindigkeiten von $1, je hin und zurück; die anderen Gelenke halten",
  ],
  [/^reversals of (.+) over (.+) at three rates: (.+)$/, "Umkehrungen von $1 über $2 mit drei Raten: $3"],
  [/^(.+) alone, one amplitude of (.+) at (.+)$/, "$1 allein, eine Amplitude von $2 bei $3"],
  [
    /^the same strokes of (.+) twice: with the other joints where its load is smallest, then largest$/,
    "dieselben Hübe von $1 zweimal: mit den anderen Gelenken dort, wo seine Last am kleinsten, dann am größten ist",
  ],
  [
    /^(.+) swing while (.+) creeps over its (?:stroke|range); the others hold$/,
    "$1 schwingen, während $2 langsam durch seinen Bereich fährt; die anderen halten",
  ],
  [/^(?:or )?(.+); or (.+)$/, "$1; oder $2"],
];

export const REPORT_FIXED: Record<string, string> = { ...EFFECTS, ...LOOK_AT, ...EXPERIMENTS, ...SIGNALS };
