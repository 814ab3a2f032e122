/** German for findings of `hilfit check` in recordings, and of the bus check; as `refusals_de.ts`. */

/** What stands in sentences as a value, and what several sentences make together. */
export const COMPOSED: Record<string, string> = {
  "nothing else": "sonst nichts",
  " (and {} more)": " (und $1 weitere)",
  late: "zu spät",
  early: "zu früh",
  largest: "größte",
  smallest: "kleinste",
  milliseconds: "Millisekunden",
  microseconds: "Mikrosekunden",
  nanoseconds: "Nanosekunden",
  minutes: "Minuten",
  hours: "Stunden",
  days: "Tagen",
  small: "klein",
  large: "groß",
  bore: "Bohrung",
  rod: "Stange",
  "{}: the rod side looks like {} of the head side's area instead of {} ({}); unexplained effort: {} as it is, {} with that":
    "$1: Die Stangenseite hat anscheinend das $2-Fache der kolbenseitigen Fläche statt $3 ($4); unerklärte Kraft: jetzt $5, damit $6",
  "with this bore the rod would be {} mm thick and with this rod the bore would be {} mm":
    "mit dieser Bohrung wäre die Stange $1 mm dick, und mit dieser Stange hätte die Bohrung $2 mm",
};

const RECORDINGS: Record<string, string> = {
  "{}: the first {} s have no pressure in any chamber, and all later ones have: the recording begins before the pumps run":
    "$1: In den ersten $2 s hat keine Kammer Druck, später haben alle: Die Aufzeichnung beginnt, bevor die Pumpen laufen",
  "cut these seconds off, or mark their rows missing":
    "diese Sekunden abschneiden oder ihre Zeilen als fehlend kennzeichnen",
  "all pressures": "alle Drücke",
  "{}: joint and piston position contradict each other ({} of the motion), and nothing that was tried explains it":
    "$1: Gelenk- und Kolbenposition widersprechen sich ($2 der Bewegung), und nichts, was versucht wurde, erklärt es",
  "look at both sensors, at the linkage, and whether the recordings are of this machine":
    "beide Aufnehmer und die Koppelkinematik ansehen, und ob die Aufzeichnungen von dieser Maschine sind",
  "{} (the two sensors disagree by {} of the motion as it is, by {} then)":
    "$1 (die beiden Aufnehmer unterscheiden sich jetzt um $2 der Bewegung, dann um $3)",
  "the clock of the efforts runs {} % slow": "die Uhr der Kräfte geht um $1 % nach",
  "the clock of the efforts runs {} % fast": "die Uhr der Kräfte geht um $1 % vor",
  "all efforts come {} s {}": "alle Kräfte kommen $1 s $2",
  "{} against the positions (unexplained effort: {} as it is, {} with that taken back)":
    "$1, gemessen an den Positionen (unerklärte Kraft: jetzt $2, ohne das $3)",
  "put both buses on one clock and record again, or move the columns":
    "beide Busse auf eine Uhr bringen und neu aufzeichnen, oder die Spalten verschieben",
  "with this bore the rod would be {} mm thick": "mit dieser Bohrung wäre die Stange $1 mm dick",
  "with this rod the bore would be {} mm": "mit dieser Stange hätte die Bohrung $1 mm",
  "{}: the rod side looks like {} of the head side's area instead of {}; unexplained effort: {} as it is, {} with that":
    "$1: Die Stangenseite hat anscheinend das $2-Fache der kolbenseitigen Fläche statt $3; unerklärte Kraft: jetzt $4, damit $5",
  "measure bore and rod, and check the units of both pressures{}":
    "Bohrung und Stange messen und die Einheiten beider Drücke prüfen$1",
  "back pressure of its valves in one direction, or friction that grows with the pressures":
    "Staudruck seiner Ventile in einer Richtung oder Reibung, die mit den Drücken wächst",
  " of {}": " von $1",
  "{} (unexplained effort{}: {} as it is, {} with that taken back)": "$1 (unerklärte Kraft$2: jetzt $3, ohne das $4)",
  "{}: the recorded effort cannot come from this machine file: {} of it is unexplained":
    "$1: Die aufgezeichnete Kraft kann nicht zu dieser Maschinendatei gehören: $2 davon sind unerklärt",
  "look at this joint's channels (unit, sign, wiring, which joint), at its cylinder and linkage{}":
    "die Kanäle dieses Gelenks (Einheit, Vorzeichen, Verdrahtung, welches Gelenk), seinen Zylinder und die Koppelkinematik ansehen$1",
  "motion of other joints that pushes it": "Bewegung anderer Gelenke, die es schiebt",
  " (as well: {})": " (ebenso möglich: $1)",
  "head and rod pressure look swapped": "kolben- und stangenseitiger Druck sind anscheinend vertauscht",
  "swap the two channels": "die beiden Kanäle tauschen",
  "{} looks as if it had the wrong sign": "$1 hat anscheinend das falsche Vorzeichen",
  "the effort looks as if it had the wrong sign": "die Kraft hat anscheinend das falsche Vorzeichen",
  "correct the sign of its scale": "das Vorzeichen von scale berichtigen",
  "correct the sign of its scale (0 is fully retracted)":
    "das Vorzeichen von scale berichtigen (0 ist ganz eingefahren)",
  "the values of {} look like {}": "die Werte von $1 sehen nach $2 aus",
  "set its unit to '{}'": "seine Einheit auf „$1“ setzen",
  "set the unit to '{}'": "die Einheit auf „$1“ setzen",
  "exchange the chambers' ends, or correct the direction in which the cylinder acts (linkage offset)":
    "die Seiten der Kammern tauschen oder die Richtung berichtigen, in der der Zylinder wirkt (offset der Koppelkinematik)",
  "{} of {} and {} look exchanged": "$1 von $2 und $3 sind anscheinend vertauscht",
  "exchange the channels' names or sources": "Namen oder Quellen der Kanäle tauschen",
  "the {} looks like {} mm instead of {} mm": "$1: anscheinend $2 mm statt $3 mm",
  "measure the {} and correct it": "messen und berichtigen: $1",
  "the effort looks {} times as large as the other joints' efforts allow":
    "die Kraft sieht $1-mal so groß aus, wie die Kräfte der anderen Gelenke zulassen",
  "check bore, lever arm (linkage) and the scale of its pressures or torque":
    "Bohrung, Hebelarm (Koppelkinematik) und scale der Drücke oder des Moments prüfen",
  "gravity looks turned over": "die Schwerkraft scheint umgedreht zu sein",
  "gravity looks like {} in the base frame": "die Schwerkraft im Basissystem sieht nach $1 aus",
  "set gravity to {}, or turn the base frame": "gravity auf $1 setzen oder das Basissystem drehen",
  "dh.{} looks like {} m instead of {} m": "dh.$1 sieht nach $2 m statt $3 m aus",
  "correct dh.{}": "dh.$1 berichtigen",
  "dh.alpha looks like {} instead of {} rad": "dh.alpha sieht nach $1 statt $2 rad aus",
  "correct dh.alpha": "dh.alpha berichtigen",
  "linkage.{} looks like {} instead of {} rad": "linkage.$1 sieht nach $2 statt $3 rad aus",
  "linkage.{} looks like {} instead of {} m": "linkage.$1 sieht nach $2 statt $3 m aus",
  "linkage.{} looks like {} instead of {} {}": "linkage.$1 sieht nach $2 statt $3 $4 aus",
  "measure the pins and correct linkage.{}": "die Bolzen messen und linkage.$1 berichtigen",
  "{}: falls to {} Pa, far below a vacuum": "$1: fällt auf $2 Pa, weit unter ein Vakuum",
  "correct the sign, the scale or the offset of this channel":
    "Vorzeichen, scale oder offset dieses Kanals berichtigen",
  "no cylinder works with so little": "mit so wenig arbeitet kein Zylinder",
  "no cylinder holds that": "das hält kein Zylinder",
  "the values look like {}": "die Werte sehen nach $1 aus",
  "they are in no unit that is known here": "eine bekannte Einheit passt nicht",
  "{}: reach {} Pa, {}; {}": "$1: bis $2 Pa, $3; $4",
  "check unit, scale and wiring": "Einheit, scale und Verdrahtung prüfen",
  "{}: reaches {} Pa, and values and noise differ from those of the other pressures by the same factor; the values look like {}":
    "$1: bis $2 Pa, und Werte und Rauschen unterscheiden sich um denselben Faktor von denen der anderen Drücke; die Werte sehen nach $3 aus",
  "it looks as if it counted the other way": "er zählt anscheinend andersherum",
  "unit, zero or sign are wrong, or the limits are":
    "Einheit, Nullpunkt oder Vorzeichen stimmen nicht, oder die Grenzen",
  "check its unit, sign and offset, and limits.position of the joint":
    "seine Einheit, sein Vorzeichen und offset prüfen, und limits.position des Gelenks",
  "{}: goes from {} to {} {}, the machine file allows {} to {}; {}":
    "$1: geht von $2 bis $3 $4, die Maschinendatei erlaubt $5 bis $6; $7",
  "{}: moves by {} of what limits allow; the values look like {}, not {}":
    "$1: bewegt sich um $2 dessen, was limits erlaubt; die Werte sehen nach $3 aus, nicht nach $4",
  "all channels of quantity {}: {} ({})": "alle Kanäle der Größe $1: $2 ($3)",
  "{} times too large": "$1-mal zu groß",
  "{} times too small": "$1-mal zu klein",
  "{} looks as if it counted the other way": "$1 zählt anscheinend andersherum",
  "{} looks {} degrees off": "$1 liegt anscheinend um $2 Grad daneben",
  "correct its offset, or theta of the joint": "offset berichtigen, oder theta des Gelenks",
  "correct its offset": "offset berichtigen",
  "{} looks {} mm too {}": "$1 ist anscheinend um $2 mm zu $3",
  "correct its offset (0 is fully retracted)": "offset berichtigen (0 ist ganz eingefahren)",
  "{} looks {}": "$1 ist anscheinend $2",
  "correct its scale (counts per turn, edges that are counted, gear ratio)":
    "scale berichtigen (Striche je Umdrehung, gezählte Flanken, Übersetzung)",
  "all efforts look {} s late against the positions": "alle Kräfte kommen anscheinend $1 s später als die Positionen",
  "all efforts look {} s early against the positions": "alle Kräfte kommen anscheinend $1 s früher als die Positionen",
  "put both buses on one clock, or move the columns": "beide Busse auf eine Uhr bringen oder die Spalten verschieben",
  "the clock of the efforts runs {} % fast against that of the positions":
    "die Uhr der Kräfte geht gegen die der Positionen um $1 % vor",
  "the clock of the efforts runs {} % slow against that of the positions":
    "die Uhr der Kräfte geht gegen die der Positionen um $1 % nach",
  "put both buses on one clock": "beide Busse auf eine Uhr bringen",
  "the motion looks {} times as fast as the time column says":
    "die Bewegung sieht $1-mal so schnell aus, wie die Zeitspalte sagt",
  "correct the time column and rate_hz": "die Zeitspalte und rate_hz berichtigen",
  "the effort looks {} s late": "die Kraft kommt anscheinend $1 s zu spät",
  "the effort looks {} s early": "die Kraft kommt anscheinend $1 s zu früh",
  "look after the delay of its device or bus": "die Verzögerung des Geräts oder des Busses prüfen",
  "head and rod pressure look swapped in this recording alone":
    "kolben- und stangenseitiger Druck sind anscheinend nur in dieser Aufzeichnung vertauscht",
  "swap the two columns of this recording, and look whether the hoses or cables were changed":
    "die beiden Spalten dieser Aufzeichnung tauschen und nachsehen, ob Schläuche oder Kabel umgesteckt wurden",
  "{} looks as if it counted the other way in this recording alone":
    "$1 zählt anscheinend nur in dieser Aufzeichnung andersherum",
  "correct the sign of this column, and look whether the sensor was changed":
    "das Vorzeichen dieser Spalte berichtigen und nachsehen, ob der Aufnehmer getauscht wurde",
  "looks as if the rods were off": "die Stangen waren anscheinend ausgehängt",
  "looks as if the rods were on the arm": "die Stangen waren anscheinend am Arm",
  "give it as unloaded": "als unloaded angeben",
  "give it as train, or take the rods off and record again":
    "als train angeben, oder die Stangen aushängen und neu aufzeichnen",
  "does not look like a recording of the machine of the other ones":
    "sieht nicht nach einer Aufzeichnung der Maschine der anderen aus",
  "look whether it is of this machine, and of this state of it":
    "nachsehen, ob sie von dieser Maschine und von diesem Zustand ist",
  "{}: is the same file as {}, given as {} and {}": "$1: ist dieselbe Datei wie $2, angegeben als $3 und $4",
  "give each recording once": "jede Aufzeichnung nur einmal angeben",
  "{}: does not repeat a training motion (positions differ by {} of their spread)":
    "$1: wiederholt keine Trainingsbewegung (Positionen unterscheiden sich um $2 ihrer Streuung)",
  "record the motion of a training recording again, or give this one as train or validate":
    "die Bewegung einer Trainingsaufzeichnung noch einmal aufzeichnen, oder diese als train oder validate angeben",
  "{}: is the motion of {} once more (positions differ by {}, efforts by {}): it cannot show how the model does on another motion":
    "$1: ist noch einmal die Bewegung von $2 (Positionen unterscheiden sich um $3, Kräfte um $4): Sie kann nicht zeigen, was das Modell bei einer anderen Bewegung leistet",
  "validate on another motion, and give this one as repeat":
    "mit einer anderen Bewegung validieren und diese als repeat angeben",
  "{}: stands still in all recordings": "$1: steht in allen Aufzeichnungen still",
  "nothing has to be done: its rows are left out; move it if its parameters are wanted":
    "nichts ist zu tun: Seine Zeilen bleiben weg; bewegen, wenn seine Parameter gebraucht werden",
  " in {} line {}": " in $1, Zeile $2",
  " in {} lines {}": " in $1, Zeilen $2",
  "correct it": "berichtigen",
  " (and {} more: {})": " (und $1 weitere: $2)",
  " (there is '{}')": " (es gibt „$1“)",
  "its range": "seines Bereichs",
  "one exact value": "eines genauen Werts",
  "{}: has no rows": "$1: hat keine Zeilen",
  "record it again": "neu aufzeichnen",
  "{}: the joints follow their pistons, so the rods are on the arm":
    "$1: Die Gelenke folgen ihren Kolben, die Stangen sind also am Arm",
  "{}: the pistons move and the joints do not, so the rods are off":
    "$1: Die Kolben bewegen sich und die Gelenke nicht, die Stangen sind also ausgehängt",
  "{}: joint and piston positions of {} of {} joints contradict the linkages, which they do not in other recordings":
    "$1: Gelenk- und Kolbenpositionen von $2 von $3 Gelenken widersprechen der Koppelkinematik, in anderen Aufzeichnungen nicht",
  "look whether it is a recording of this machine, and whether a sensor has slipped":
    "nachsehen, ob sie von dieser Maschine ist und ob sich ein Aufnehmer verschoben hat",
  "an identification leaves them out as well; begin to record later, or look at that position sensor":
    "eine Identifikation lässt sie ebenfalls weg; später mit der Aufzeichnung beginnen oder diesen Wegaufnehmer ansehen",
  "{}: has only {} levels within its motion": "$1: hat innerhalb seiner Bewegung nur $2 Stufen",
  "record it with its full resolution (data type, scale)": "mit voller Auflösung aufzeichnen (Datentyp, scale)",
  "{}: a new value comes only every {} rows ({} Hz instead of {} Hz)":
    "$1: Ein neuer Wert kommt nur alle $2 Zeilen ($3 Hz statt $4 Hz)",
  "read this device at the machine's rate, or resample all channels to its own":
    "dieses Gerät mit der Rate der Maschine lesen oder alle Kanäle auf seine Rate umtasten",
  "{}: falls to exactly {} and comes back {} times (the first at {} s)":
    "$1: fällt auf genau $2 und kommt zurück, $3-mal (zuerst bei $4 s)",
  "look after cable, plug and supply of this device, and mark the rows missing":
    "Kabel, Stecker und Versorgung dieses Geräts prüfen und die Zeilen als fehlend kennzeichnen",
  "{}: {} single values are far off (the first at {} s, up to {} of the signal's range)":
    "$1: $2 einzelne Werte liegen weit daneben (zuerst bei $3 s, bis $4 des Signalbereichs)",
  "look after cable, shielding and sentinel values of this device, and mark the rows missing":
    "Kabel, Schirmung und Fehlerwerte dieses Geräts prüfen und die Zeilen als fehlend kennzeichnen",
  "{}: jumps by {} to and fro {} times (the first at {} s): the encoder wraps within the motion":
    "$1: springt um $2 hin und her, $3-mal (zuerst bei $4 s): Der Geber läuft innerhalb der Bewegung über",
  "move the encoder's zero out of the range of motion, or unwrap it in the device":
    "den Nullpunkt des Gebers aus dem Bewegungsbereich legen oder den Überlauf im Gerät aufheben",
  "{}: jumps by {} from one row to the next at {} s, as no machine moves":
    "$1: springt bei $3 s von einer Zeile zur nächsten um $2; so bewegt sich keine Maschine",
  "look after this sensor (loose coupling, lost counts, restart) and record again, or split the recording there":
    "diesen Aufnehmer prüfen (lose Kupplung, verlorene Striche, Neustart) und neu aufzeichnen, oder die Aufzeichnung dort teilen",
  "{}: does not change for {} s from {} s on, although it does elsewhere":
    "$1: ändert sich ab $3 s für $2 s nicht, anderswo schon",
  "look after this device and its bus, and mark the rows missing":
    "dieses Gerät und seinen Bus prüfen und die Zeilen als fehlend kennzeichnen",
  "{}: {} of {} values are exactly its {} one ({}): it is clipped there":
    "$1: $2 von $3 Werten sind genau der $4 ($5): Dort ist er abgeschnitten",
  "use a sensor or an amplifier of wider range, and declare its range":
    "einen Aufnehmer oder Verstärker mit größerem Bereich verwenden und dessen range angeben",
  "{}: has the very values of {}": "$1: hat genau die Werte von $2",
  "correct the source (node, object, register) of one of the two channels":
    "die Quelle (Knoten, Objekt, Register) eines der beiden Kanäle berichtigen",
  "{}: time: goes from {} to {} s in row {}, and so in {} more rows":
    "$1: time: geht in Zeile $4 von $2 auf $3 s, ebenso in $5 weiteren Zeilen",
  "{}: time: goes from {} to {} s in row {}": "$1: time: geht in Zeile $4 von $2 auf $3 s",
  "sort the rows, or split the file there": "die Zeilen sortieren oder die Datei dort teilen",
  "{}: time: looks like {} instead of seconds (steps of {})":
    "$1: time: sieht nach $2 statt Sekunden aus (Schritte von $3)",
  "divide the column by {}, or write its unit": "die Spalte durch $1 teilen oder ihre Einheit schreiben",
  "write it in seconds": "in Sekunden schreiben",
  "{}: time: {} rows in a second, the machine file says rate_hz {}":
    "$1: time: $2 Zeilen je Sekunde, die Maschinendatei sagt rate_hz $3",
  "correct rate_hz, or the column if the recorder ran at another rate than it says":
    "rate_hz berichtigen, oder die Spalte, wenn der Rekorder mit einer anderen Rate lief, als sie sagt",
  "{}: time: jumps by {} s at {} s, and the machine stands where it stood: the clock was set":
    "$1: time: springt bei $3 s um $2 s, und die Maschine steht, wo sie stand: Die Uhr wurde gestellt",
  "take the time of a clock that nobody sets, or split the file there":
    "die Zeit einer Uhr nehmen, die niemand stellt, oder die Datei dort teilen",
  "{}: time: {} gaps, {} s in all, the first at {} s": "$1: time: $2 Lücken, zusammen $3 s, die erste bei $4 s",
  "look after the bus or the recorder": "den Bus oder den Rekorder prüfen",
  "nothing has to be done: rows beside a gap are left out": "nichts ist zu tun: Zeilen neben einer Lücke bleiben weg",
  "{} look swapped at every joint": "$1 sind anscheinend an jedem Gelenk vertauscht",
  "{} of every joint look as if they had the wrong sign": "$1 jedes Gelenks haben anscheinend das falsche Vorzeichen",
  "{} looks {} s {} against the joint's sensor": "$1 kommt anscheinend $2 s $3, gemessen am Aufnehmer des Gelenks",
  "the clock of {} runs {} % fast against that of the joint's sensor":
    "die Uhr von $1 geht gegen die des Gelenkaufnehmers um $2 % vor",
  "the clock of {} runs {} % slow against that of the joint's sensor":
    "die Uhr von $1 geht gegen die des Gelenkaufnehmers um $2 % nach",
  "{}: the piston of {} moves and its joint does not follow; put the rod on the arm, say that the recording is 'unloaded' instead of '{}', or correct the linkage in the machine file":
    "$1: Der Kolben von $2 bewegt sich, und sein Gelenk folgt nicht; die Stange an den Arm hängen, die Aufzeichnung als „unloaded“ statt „$3“ angeben oder die Koppelkinematik in der Maschinendatei berichtigen",
  "{}: {} moves with its piston, so its rod is on the arm; take it off for an 'unloaded' recording, or say 'train'":
    "$1: $2 bewegt sich mit seinem Kolben, seine Stange ist also am Arm; für eine „unloaded“-Aufzeichnung aushängen oder „train“ sagen",
  "{} to {} s": "$1 bis $2 s",
  "{} and {} more": "$1 und $2 weitere",
  "the cylinders hold or move the arm there, so the rods were on":
    "dort halten oder bewegen die Zylinder den Arm, die Stangen waren also dran",
  "the piston is up to {} mm from where its joint says, so the rods were not on the arm":
    "der Kolben steht bis zu $1 mm neben dem, was sein Gelenk sagt, die Stangen waren also nicht am Arm",
  "{} ({}): {} left out: {} ({})": "$1 ($2): weggelassen: $3: $4 ($5)",
};

const BUSES: Record<string, string> = {
  "delays between the buses are not told: that takes a motion of 15 s or more; give one with --recording":
    "Verzögerungen zwischen den Bussen sind nicht zu sagen: Das braucht eine Bewegung von mindestens 15 s; mit --recording eine angeben",
  "not at rest: {} of {} channels move ({}); their values and drifts are not those of a machine that stands still":
    "nicht in Ruhe: $1 von $2 Kanälen bewegen sich ($3); ihre Werte und Driften sind nicht die einer stehenden Maschine",
  "bus '{}': is listen_only, so no device was asked who it is":
    "Bus „$1“: ist listen_only, also wurde kein Gerät gefragt, wer es ist",
  "{}: only {} values came ({}); see its device": "$1: nur $2 Werte kamen ($3); sein Gerät ansehen",
  "{}: {} % of the cycles brought a value ({}); see its device":
    "$1: In $2 % der Takte kam ein Wert ($3); sein Gerät ansehen",
  "{}: did not change once, although its noise_std is {} {}":
    "$1: hat sich kein einziges Mal geändert, obwohl sein noise_std $2 $3 ist",
  "{}: noise is {} {}, {} times what noise_std and resolution say; look at shield and earth, or correct noise_std":
    "$1: Das Rauschen ist $2 $3, das $4-Fache dessen, was noise_std und resolution sagen; Schirm und Erdung ansehen oder noise_std berichtigen",
  "{}: is at {} {}, outside its range {}": "$1: steht bei $2 $3, außerhalb seines Bereichs $4",
  "{}: drifts by {} ± {} {} a minute; is it warm, and does nothing sink?":
    "$1: driftet um $2 ± $3 $4 je Minute; ist er warm, und sinkt nichts ab?",
  "{}: shows {} {} without pressure; if there is none, write offset: {} in its source":
    "$1: zeigt drucklos $2 $3; wenn kein Druck da ist, offset: $4 in seine Quelle schreiben",
  "bus '{}' node {}": "Bus „$1“ Knoten $2",
  "{}: {} is {}, the machine file says 0x{}; which device is it?":
    "$1: $2 ist $3, die Maschinendatei sagt 0x$4; welches Gerät ist es?",
  "{}: has firmware '{}', the machine file says '{}'": "$1: hat die Firmware „$2“, die Maschinendatei sagt „$3“",
  "{}: node {} measures in {}, the channel in {}; correct one":
    "$1: Knoten $2 misst in $3, der Kanal in $4; eines berichtigen",
  "{}: by its own objects node {} has {} times the machine file's scaling ({}); correct scale ({}) or set the device":
    "$1: Nach seinen eigenen Objekten hat Knoten $2 das $3-Fache der Skalierung der Maschinendatei ($4); scale ($5) berichtigen oder das Gerät einstellen",
  "node {}": "Knoten $1",
  "unit {}": "Einheit $1",
};

/** What drivers say of devices that do not run. */
const DEVICES: Record<string, string> = {
  "{} (it was away for {} s)": "$1 (es war $2 s lang weg)",
  "{}: booted; it is being commissioned again": "$1: neu gestartet; wird wieder in Betrieb genommen",
  "{}: TPDOs of a wrong length": "$1: TPDOs falscher Länge",
  "reset since": "seither zurückgesetzt",
  "{}: emergency {}; see its manual": "$1: Emergency $2; siehe sein Handbuch",
  "emergency, other codes": "Emergency, andere Codes",
  "{}: no heartbeat for {} s; check its power and cable": "$1: kein Heartbeat seit $2 s; Versorgung und Kabel prüfen",
  "{}: sends no TPDOs; it is being commissioned again": "$1: sendet keine TPDOs; wird wieder in Betrieb genommen",
  "{}: TPDOs come, but no heartbeat; check what else writes to it (0x1017)":
    "$1: TPDOs kommen, aber kein Heartbeat; prüfen, was sonst in ihn schreibt (0x1017)",
  "{}: its TPDOs come {} ms after SYNC, so they are marked late":
    "$1: Seine TPDOs kommen $2 ms nach SYNC und sind deshalb als verspätet gekennzeichnet",
  "{}: has not answered yet; check its power": "$1: hat noch nicht geantwortet; Versorgung prüfen",
  "{}: {} did not come within {} SYNCs; see its manual for synchronous transmission":
    "$1: $2 kam nicht innerhalb von $3 SYNCs; im Handbuch unter synchroner Übertragung nachsehen",
  "{}: commissioning broke ({}: {}); it is tried again":
    "$1: Die Inbetriebnahme brach ab ($2: $3); sie wird wieder versucht",
  "bus '{}': opening it broke ({}: {})": "Bus „$1“: Das Öffnen brach ab ($2: $3)",
  "bus '{}': {}; it is opened again": "Bus „$1“: $2; er wird wieder geöffnet",
  "{}: more TPDOs than SYNCs: two devices have this node-ID, or something else sends SYNC as well; give each device an ID of its own, and let only one send SYNC":
    "$1: mehr TPDOs als SYNCs: Zwei Geräte haben diese Node-ID, oder etwas anderes sendet auch SYNC; jedem Gerät eine eigene ID geben und nur eines SYNC senden lassen",
  "{}: TPDO{} has {} bytes instead of {}; its mapping is not the one that was written: see its manual":
    "$1: TPDO$2 hat $3 Bytes statt $4; sein Mapping ist nicht das geschriebene: siehe sein Handbuch",
  "{}: says {} decimals ({}), which cannot be; correct decimals_object":
    "$1: sagt $2 Dezimalstellen ($3), was nicht sein kann; decimals_object berichtigen",
  "bus '{}' node {} ({})": "Bus „$1“ Knoten $2 ($3)",
  "{}: reading it broke ({}: {})": "$1: Das Lesen brach ab ($2: $3)",
  "{}: {} ({}); check its power, address and cable": "$1: $2 ($3); Versorgung, Adresse und Kabel prüfen",
  "{}: exception {} ({}) for {}; correct decimals_register":
    "$1: Ausnahme $2 ($3) für $4; decimals_register berichtigen",
  "{}: {}, holds {}, which cannot be; correct decimals_register":
    "$1: $2 enthält $3, was nicht sein kann; decimals_register berichtigen",
  "{}: answers in {} ms, so its values come {}, and are marked late":
    "$1: antwortet in $2 ms, seine Werte kommen also $3 und sind als verspätet gekennzeichnet",
  "{}: exception {} ({}) for {}; see its manual": "$1: Ausnahme $2 ($3) für $4; siehe sein Handbuch",
};

export const FINDINGS: Record<string, string> = { ...RECORDINGS, ...BUSES, ...DEVICES };
