/** German for what an identification of valves says (`fitting/valve`): effects, laws, checks, and what it refuses. */
export const VALVE: Record<string, string> = {
  "From commands to speeds, valve by valve": "Von Stellwerten zu Geschwindigkeiten, Ventil für Ventil",
  "from commands to speeds, valve by valve": "Von Stellwerten zu Geschwindigkeiten, Ventil für Ventil",
  "the valve of {}": "das Ventil von $1",
  "no law of the pressure": "kein Gesetz des Drucks",
  "an orifice that feeds the cylinder": "eine Blende, die den Zylinder speist",
  "an orifice that the cylinder empties through": "eine Blende, durch die der Zylinder sich leert",
  "a compensator that needs its margin": "eine Druckwaage, die ihren Abstand braucht",
  "a power of the drop that feeds the cylinder": "eine Potenz des Druckabfalls, der den Zylinder speist",
  "--after: is no valve report; give the valve.json of hilfit valve":
    "--after: ist kein Ventilbericht; geben Sie die valve.json von hilfit valve an",
  "joint '{}': has no cylinder.valve; one of {}": "Gelenk '$1': hat kein cylinder.valve; eines von $2",
  "{}: a command of {} of full is all that --level, its speed and its travel allow, if it is 30 % faster than expected, and hardly moves it; give --after with a valve report":
    "$1: ein Stellwert von $2 des vollen ist alles, was --level, seine Geschwindigkeit und sein Weg zulassen, wenn es 30 % schneller ist als erwartet, und bewegt es kaum; geben Sie --after mit einem Ventilbericht an",
  "{}: no joint has a cylinder.valve; describe one in the machine file":
    "$1: kein Gelenk hat ein cylinder.valve; beschreiben Sie eines in der Maschinendatei",
  "hysteresis of the spool": "Hysterese des Schiebers",
  "dither of the amplifier, dirt in the spool, the solenoid":
    "Dither des Verstärkers, Schmutz im Schieber, den Magneten",
  "the ladder of small steps around each edge, up and down, at two speeds":
    "die Leiter kleiner Schritte um jede Kante, auf und ab, mit zwei Geschwindigkeiten",
  "another delay in each direction": "eine andere Verzögerung in jeder Richtung",
  "the two solenoids, and a counterbalance valve": "die beiden Magnete und ein Senkbremsventil",
  "steps of both signs from rest": "Sprünge beider Vorzeichen aus der Ruhe",
  "speeds that change as the oil gets warm": "Geschwindigkeiten, die sich mit dem warmen Öl ändern",
  "oil temperature and viscosity grade": "Öltemperatur und Viskositätsklasse",
  "the same cycle cold and warm, with the oil's temperature": "derselbe Zyklus kalt und warm, mit der Öltemperatur",
  "the outlet's edge decides where the load pulls": "die Kante des Auslasses entscheidet, wo die Last zieht",
  "counterbalance and throttle-check valves, the outlet edges of the spool":
    "Senkbrems- und Drosselrückschlagventile, die Auslasskanten des Schiebers",
  "the same speeds with the load pulling and pushing": "dieselben Geschwindigkeiten mit ziehender und drückender Last",
  "an orifice where the machine file says compensated": "eine Blende, wo die Maschinendatei eine Druckwaage nennt",
  "the compensator, and compensated: of the machine file": "die Druckwaage, und compensated: der Maschinendatei",
  "the same command at two loads": "derselbe Stellwert bei zwei Lasten",
  "a leak past the piston": "ein Leck am Kolben vorbei",
  "the piston's seal": "die Kolbendichtung",
  "rest with the valve closed at a loaded pose: the head's pressure falls and the rod's rises":
    "Ruhe mit geschlossenem Ventil in belasteter Stellung: Der Druck am Boden fällt, der an der Stange steigt",
  "a leak from the ports to the tank": "ein Leck von den Anschlüssen zum Tank",
  "the spool, relief and anti-cavitation valves": "Schieber, Druckbegrenzungs- und Nachsaugventile",
  "rest with the valve closed at a loaded pose: both pressures fall, and the load sinks":
    "Ruhe mit geschlossenem Ventil in belasteter Stellung: Beide Drücke fallen, und die Last sinkt",
  "a gain that follows {}": "eine Verstärkung, die von $1 abhängt",
  "the same commands at different values of this variable, all else as it was":
    "dieselben Stellwerte bei verschiedenen Werten dieser Größe, alles andere wie zuvor",
  "{} looks as if it had the wrong sign: turned round it leaves {} of the speed unexplained, not {}":
    "$1 sieht aus, als hätte es das falsche Vorzeichen: umgedreht lässt es $2 der Geschwindigkeit unerklärt, nicht $3",
  "write extends: {} in its valve, or look at swapped position and pressures":
    "extends: $1 in sein Ventil schreiben, oder nach vertauschter Position und Drücken sehen",
  "{} explains next to nothing of the speed ({} of it is left)":
    "$1 erklärt fast nichts von der Geschwindigkeit ($2 bleiben übrig)",
  "look whether it is the command of this axis, and in time with the positions":
    "nachsehen, ob es der Stellwert dieser Achse ist, und zeitgleich mit den Positionen",
  "{} shows no dead band: it looks recorded before the controller's compensation":
    "$1 zeigt kein Totband: Es sieht aus, als sei vor dem Ausgleich der Steuerung aufgezeichnet",
  "record the value that is sent to the amplifier; what is before it tells of the controller":
    "den Wert aufzeichnen, der an den Verstärker geht; was davor liegt, sagt etwas über die Steuerung",
  "{} is {} s ahead of the speed, which is all that was searched":
    "$1 ist der Geschwindigkeit $2 s voraus, weiter wurde nicht gesucht",
  "look at the clocks of both buses": "die Uhren beider Busse ansehen",
  "{} was never seen to {} by its valve": "$1: sein Ventil hat nie eine Bewegung gezeigt ($2)",
  "record motion in both directions": "Bewegung in beide Richtungen aufzeichnen",
  "commands that {} beyond {} % of full were never recorded":
    "Stellwerte über $2 % des vollen wurden nie aufgezeichnet ($1)",
  "record higher levels; the inverse is clipped there": "höhere Stufen aufzeichnen; die Umkehrung endet dort",
  "no chamber pressures: the curve and the delay only": "keine Drücke der Kammern: nur Kennlinie und Verzögerung",
  "add a supply_pressure channel, or supply: {pressure: ...}":
    "einen Kanal supply_pressure ergänzen, oder supply: {pressure: ...}",
  "nobody knows the supply pressure: an orifice that feeds the cylinder cannot be told from a compensated valve, and speeds at another load are predicted worse":
    "Der Versorgungsdruck ist nicht bekannt: Eine Blende, die den Zylinder speist, ist von einem Ventil mit Druckwaage nicht zu unterscheiden, und Geschwindigkeiten bei anderer Last werden schlechter vorhergesagt",
  "{}: does not move by its command in any recording; nothing is said of it":
    "$1: bewegt sich in keiner Aufzeichnung durch seinen Stellwert; darüber wird nichts gesagt",
  "joints.{}: has no valve; add cylinder.valve: and a channel of quantity command":
    "joints.$1: hat kein Ventil; cylinder.valve: und einen Kanal der Größe command ergänzen",
  "joints.{}: no channel shows its valve's command; add one of quantity command":
    "joints.$1: Kein Kanal zeigt den Stellwert seines Ventils; einen der Größe command ergänzen",
  "machine '{}' has no channel of quantity command; add one for each valve that is recorded":
    "Maschine „$1“ hat keinen Kanal der Größe command; einen für jedes Ventil ergänzen, das aufgezeichnet wird",
  "valve: no recording; give at least one in which the axes move by their valves":
    "Ventile: keine Aufzeichnung; mindestens eine angeben, in der die Achsen sich durch ihre Ventile bewegen",
  "{}: is fitted and judged on at once; give a recording of another motion":
    "$1: soll angepasst und zugleich beurteilt werden; eine Aufzeichnung einer anderen Bewegung angeben",
  "{}: its valve was never seen to move it; there is nothing to export":
    "$1: Sein Ventil hat es nie bewegt; es gibt nichts auszugeben",
  "{}: {}: no axis is moved by its command; record a motion, or look whether the command channel is that of this axis":
    "$1: $2: Keine Achse bewegt sich durch ihren Stellwert; eine Bewegung aufzeichnen oder nachsehen, ob der Kanal command zu dieser Achse gehört",
  "{}: {}: no stretch of {} s without a gap; record again or raise the bandwidth":
    "$1: $2: kein Stück von $3 s ohne Lücke; noch einmal aufzeichnen oder die Bandbreite erhöhen",
  "there is no identification of valves '{}'": "Es gibt keine Identifikation von Ventilen „$1“",
  "valves '{}' have no inverse: none was seen to move its axis":
    "Zu den Ventilen „$1“ gibt es keine Umkehrung: Keines hat seine Achse bewegt",
  "{} '{}' has no {}: its job {} is {}": "$1 „$2“ hat kein $3: Der Auftrag $4 ist: $5",
};
