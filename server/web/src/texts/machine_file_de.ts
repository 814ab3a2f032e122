/**
 * German for what is wrong with a machine file: what stands behind file, line and key; as `refusals_de.ts`.
 *
 * Doubts (`hilfit machine check`) are among the findings of recordings, too.
 */
export const MACHINE_FILE: Record<string, string> = {
  "delays[{}]: '{}' and '{}' are told twice; keep one": "delays[$1]: „$2“ und „$3“ stehen zweimal da; eines behalten",
  "; there are {}": "; es gibt $1",
  "'{}' is no host; write a name or an address, as in 192.0.2.10":
    "„$1“ ist kein Rechner; einen Namen oder eine Adresse schreiben, wie 192.0.2.10",
  "'{}' is no place; write can:socketcan:can0, serial:/dev/ttyUSB0 or tcp:192.0.2.0/24:502":
    "„$1“ ist kein Ort; can:socketcan:can0, serial:/dev/ttyUSB0 oder tcp:192.0.2.0/24:502 schreiben",
  "'{}' is no serial port; write /dev/ttyUSB0, /dev/serial/by-id/..., or COM3":
    "„$1“ ist keine serielle Schnittstelle; /dev/ttyUSB0, /dev/serial/by-id/... oder COM3 schreiben",
  "channel '{}' is none of {}; write its name alone, as in can0":
    "channel „$1“ gibt es bei $2 nicht; nur den Namen schreiben, wie can0",
  "options: {}: {}; {} takes {}": "options: $1: $2; $3 nimmt $4",
  "{}: there is no {} '{}'{}": "$1: $2 „$3“ gibt es nicht$4",
  "{}: a {} belongs to a joint; add joint:": "$1: $2 gehört zu einem Gelenk; joint: ergänzen",
  "{}: a {} belongs to the machine; remove joint:": "$1: $2 gehört zur Maschine; joint: entfernen",
  "{}: its source does not fit bus '{}' of type {}": "$1: source passt nicht zum Bus „$2“ der Art $3",
  "{}: its encoder begins anew at {} and {}, and {} moves from {} to {}; correct modulo, scale or offset":
    "$1: Der Geber beginnt bei $2 und $3 von vorn, und $4 bewegt sich von $5 bis $6; modulo, scale oder offset berichtigen",
  "{}: {} has no drive, so no {}; add drive: with its ratio":
    "$1: $2 hat keinen Antrieb, also kein $3; drive: mit seiner ratio ergänzen",
  "{}: the drive of {} says effort: link_side, which is a joint_effort; correct one":
    "$1: Der Antrieb von $2 sagt effort: link_side, das ist ein joint_effort; eines berichtigen",
  "{}: {} has no cylinder, so no {}": "$1: $2 hat keinen Zylinder, also kein $3",
  "{}: this chamber of {} is vented; remove the channel, or vented:":
    "$1: Diese Kammer von $2 ist entlüftet; den Kanal oder vented: entfernen",
  "buses: {}: node {}: settings would write {}, a valve's command; no command is ever sent: remove it":
    "buses: $1: Knoten $2: settings würde $3 schreiben, den Stellwert eines Ventils; Stellwerte werden nie gesendet: entfernen",
  "{}: {} has no valve, so no {}; add cylinder.valve:":
    "$1: $2 hat kein Ventil, also kein $3; cylinder.valve: ergänzen",
  "{}: is in {}, and the valve of {} in {}; write both as it is sent":
    "$1: ist in $2, und das Ventil von $3 in $4; beides so schreiben, wie es gesendet wird",
  "supply: {} is {} here and {} as hydraulics.{}; correct one":
    "supply: $1 ist hier $2 und als hydraulics.$4 $3; eines berichtigen",
  "'{}' is no unit of a command; use one of {}": "„$1“ ist keine Einheit eines Stellwerts; eine nehmen von $2",
  "must be 1 or -1: the sign of command - neutral that extends the rod":
    "muss 1 oder -1 sein: das Vorzeichen von command - neutral, das die Stange ausfährt",
  "range must go from low to high, not {} to {}": "range muss von klein nach groß gehen, nicht von $1 bis $2",
  "neutral {} is not inside range {} to {}; write the command at which the spool is centred":
    "neutral $1 liegt nicht in range $2 bis $3; den Stellwert schreiben, bei dem der Schieber in der Mitte steht",
  "no channel shows what this valve is told, so nothing of it can be identified":
    "kein Kanal zeigt, was diesem Ventil befohlen wird; so ist nichts von ihm zu identifizieren",
  "add a channel of quantity command, joint {}, in {}": "einen Kanal der Größe command ergänzen, joint $1, in $2",
  "without both chamber pressures only the curve and the delay can be told: speeds at another load are predicted worse":
    "ohne beide Kammerdrücke sind nur Kennlinie und Totzeit zu sagen: Geschwindigkeiten bei anderer Last werden schlechter vorhergesagt",
  "add head_pressure and rod_pressure": "head_pressure und rod_pressure ergänzen",
  "nothing tells the supply pressure: an orifice that feeds the cylinder cannot be told from a compensated valve, and speeds at another load are predicted worse":
    "nichts sagt den Versorgungsdruck: Eine Blende im Zulauf ist von einem druckkompensierten Ventil nicht zu unterscheiden, und Geschwindigkeiten bei anderer Last werden schlechter vorhergesagt",
  "add a supply_pressure channel, or supply: {pressure: ...} in Pa":
    "einen Kanal supply_pressure ergänzen, oder supply: {pressure: ...} in Pa",
  "joints.{}: drive.coupled names the joint itself; that is ratio":
    "joints.$1: drive.coupled nennt das Gelenk selbst; das ist ratio",
  "joints.{}: has more than one {} channel; keep one": "joints.$1: hat mehr als einen Kanal $2; einen behalten",
  "joints.{}: has no position; add a channel of quantity {}":
    "joints.$1: hat keine Position; einen Kanal der Größe $2 ergänzen",
  "joint_position or motor_position": "joint_position oder motor_position",
  "joint_position or piston_position": "joint_position oder piston_position",
  "joints.{}: an external_force needs head_pressure and rod_pressure; add them":
    "joints.$1: Eine external_force braucht head_pressure und rod_pressure; beide ergänzen",
  "joints.{}: has no effort: one pressure is not enough; add a {} channel":
    "joints.$1: hat keine Kraftgröße: ein Druck genügt nicht; einen Kanal $2 ergänzen",
  "joints.{}: has no effort; add head_pressure and rod_pressure, cylinder_force, or joint_effort":
    "joints.$1: hat keine Kraftgröße; head_pressure und rod_pressure, cylinder_force oder joint_effort ergänzen",
  "joints.{}: has no effort; its drive says effort: link_side, so add a channel of quantity joint_effort":
    "joints.$1: hat keine Kraftgröße; sein Antrieb sagt effort: link_side, also einen Kanal der Größe joint_effort ergänzen",
  "joints.{}: has no effort; add a channel of quantity joint_effort, or motor_effort of {}":
    "joints.$1: hat keine Kraftgröße; einen Kanal der Größe joint_effort ergänzen, oder motor_effort von $2",
  "joints.{}: its motor_velocity holds the speed of {} too, which nothing measures; add joint_velocity or motor_velocity of {}, or remove this motor_velocity":
    "joints.$1: motor_velocity enthält auch die Geschwindigkeit von $2, die nichts misst; joint_velocity oder motor_velocity von $3 ergänzen oder dieses motor_velocity entfernen",
  "joints.{}: drive: all motors together do not tell the joints' positions; correct ratio, coupled":
    "joints.$1: drive: alle Motoren zusammen ergeben die Gelenkpositionen nicht; ratio, coupled berichtigen",
  "buses: {} both say sync: external; one of them leads the cycle":
    "buses: $1 sagen beide sync: external; einer von ihnen führt den Takt",
  "{} must go from low to high, not {} to {}": "$1 muss von klein nach groß gehen, nicht von $2 bis $3",
  "{} '{}' is there {} times; names must differ": "$1 „$2“ gibt es $3-mal; Namen müssen verschieden sein",
  "rod {} m must be thinner than the bore {} m": "rod $1 m muss dünner sein als die Bohrung $2 m",
  "ratio must not be 0; give the motor's turns per turn of the joint":
    "ratio darf nicht 0 sein; die Umdrehungen des Motors je Umdrehung des Gelenks angeben",
  "coupled[{}].ratio must not be 0; leave the coupling out":
    "coupled[$1].ratio darf nicht 0 sein; die Kopplung weglassen",
  "has both a cylinder and a drive; remove one": "hat Zylinder und Antrieb; eines entfernen",
  "cylinder.linkage of type {} needs a revolute joint; use direct, or rack":
    "cylinder.linkage der Art $1 braucht ein Drehgelenk; direct oder rack nehmen",
  "cylinder.linkage cannot close: the pins are {} to {} m apart, the cylinder {} to {} m; check {}":
    "cylinder.linkage schließt nicht: Die Bolzen liegen $1 bis $2 m auseinander, der Zylinder hat $3 bis $4 m; prüfen: $5",
  "cylinder.linkage cannot close: within limits.position the piston would have to be at {} to {} m of a stroke of {} m; check {}":
    "cylinder.linkage schließt nicht: Innerhalb von limits.position müsste der Kolben bei $1 bis $2 m eines Hubs von $3 m stehen; prüfen: $4",
  "cylinder.linkage passes a dead centre within limits.position (the lever arm becomes zero); narrow the limits or correct {}":
    "cylinder.linkage geht innerhalb von limits.position durch einen Totpunkt (der Hebelarm wird null); die Grenzen enger setzen oder berichtigen: $1",
  "cylinder.stroke {} m is exceeded: limits.position needs {} to {} m; narrow limits.position or correct the linkage":
    "cylinder.stroke $1 m reicht nicht: limits.position braucht $2 bis $3 m; limits.position enger setzen oder die Koppelkinematik berichtigen",
  "cylinder.linkage cannot close: at q = {} rad coupler_pin is {} m from rocker_pivot, coupler_arm and coupler together reach {} to {} m; check them and the points, or narrow limits.position":
    "cylinder.linkage schließt nicht: Bei q = $1 rad ist coupler_pin $2 m von rocker_pivot entfernt, coupler_arm und coupler reichen zusammen von $3 bis $4 m; diese und die Punkte prüfen oder limits.position enger setzen",
  "retracted or offset": "retracted oder offset",
  "retracted, the four points or angle": "retracted, die vier Punkte oder angle",
  "retracted, the points, side or angle": "retracted, die Punkte, side oder angle",
  "the four points, retracted": "die vier Punkte, retracted",
  "the first coefficient": "den ersten Koeffizienten",
  "the points or angle": "die Punkte oder angle",
  "the points, side or angle": "die Punkte, side oder angle",
  "the coefficients": "die Koeffizienten",
  "coupled joint": "gekoppeltes Gelenk",
  "'{}' is no {}": "„$1“: erwartet ist $2",
  "mask; write it as 0x00FFFFFF": "eine Maske, als 0x00FFFFFF geschrieben",
  "object index; write it as 0x6004": "ein Objektindex, als 0x6004 geschrieben",
  "mask is for integers, and this is {}; remove mask": "mask ist für ganze Zahlen, und das ist $1; mask entfernen",
  "mask 0x{} has more bits than {}; correct one": "mask 0x$1 hat mehr Bits als $2; eines berichtigen",
  "mask 0x{} has a gap; give bits that are in one piece, as in 0x0FF0":
    "mask 0x$1 hat eine Lücke; zusammenhängende Bits angeben, wie in 0x0FF0",
  "{} and {} do not go together; keep one": "$1 und $2 gehen nicht zusammen; eines behalten",
  "'{}' is no object; write it as \"0x6132:1\"": '„$1“ ist kein Objekt; als "0x6132:1" schreiben',
  "'{}' is no object; write it as \"0x6131:1\"": '„$1“ ist kein Objekt; als "0x6131:1" schreiben',
  "'{}': unknown data type; write it as \"0x6131:1 uint32\"":
    '„$1“: unbekannter Datentyp; als "0x6131:1 uint32" schreiben',
  "message and pgn both say which message has signal '{}'; keep one":
    "message und pgn sagen beide, welche Botschaft das Signal „$1“ hat; eines behalten",
  "sync: external means that another master leads; add listen_only: true":
    "sync: external heißt, dass ein anderer Master führt; listen_only: true ergänzen",
  "there is no bus type '{}'{}": "Die Busart „$1“ gibt es nicht$2",
  "bus '{}' cannot be behind itself; name two buses":
    "Bus „$1“ kann nicht hinter sich selbst liegen; zwei Busse nennen",
  "unknown unit '{}'; use one that measures {}": "unbekannte Einheit „$1“; eine nehmen, die $2 misst",
  "unit '{}' cannot be turned into {}": "Einheit „$1“ lässt sich nicht in $2 umrechnen",
  "{} and {} are the same point ({}, {}); correct one": "$1 und $2 sind derselbe Punkt ($3, $4); einen berichtigen",
  "supply_pressure {} Pa must be above tank_pressure {} Pa":
    "supply_pressure $1 Pa muss über tank_pressure $2 Pa liegen",
  "; did you mean '{}'?": "; war „$1“ gemeint?",
  "unknown key{}": "unbekannter Schlüssel$1",
  "unknown key; remove it": "unbekannter Schlüssel; ihn entfernen",
  "this key is missing": "dieser Schlüssel fehlt",
  "write letters, digits, '_', '-' and '.', beginning with a letter or '_'":
    "Buchstaben, Ziffern, „_“, „-“ und „.“ schreiben, mit einem Buchstaben oder „_“ am Anfang",
  "{} (found {})": "$1 (gefunden: $2)",
  "{}: the bus's file has {} in {}, the channel says {}": "$1: Die Datei des Busses hat $2 in $3, der Kanal sagt $4",
  "{}; correct unit, or give scale and offset": "$1; unit berichtigen oder scale und offset angeben",
  "there is no message of PGN 0x{} in the bus's files; correct pgn":
    "In den Dateien des Busses gibt es keine Botschaft der PGN 0x$1; pgn berichtigen",
  "there is no message '{}' in the bus's files{}": "In den Dateien des Busses gibt es keine Botschaft „$1“$2",
  " in message '{}'": " in der Botschaft „$1“",
  "there is no signal '{}'{}": "Es gibt kein Signal „$1“$2",
  "signal '{}' is in {} messages ({}); add message": "Das Signal „$1“ ist in $2 Botschaften ($3); message ergänzen",
  "message '{}' has 11 bits, so it is no J1939; remove source_address":
    "Botschaft „$1“ hat 11 Bits, ist also kein J1939; source_address entfernen",
  "message '{}' has {} bytes, which J1939 sends in several frames; they are not put together: take another message":
    "Botschaft „$1“ hat $2 Bytes, die J1939 in mehreren Telegrammen sendet; sie werden nicht zusammengesetzt: eine andere Botschaft nehmen",
  "an alias stands for what it is part of": "ein Alias steht für das, wovon er ein Teil ist",
  "nested more than {} deep": "tiefer als $1 verschachtelt",
  "values of the kind {} are not read": "Werte der Art $1 werden nicht gelesen",
  "more than {} values, aliases counted as what they stand for":
    "mehr als $1 Werte, Aliase gezählt als das, wofür sie stehen",
  "no number that can be read": "keine lesbare Zahl",
  "{} {} {} is outside the usual {} to {} {}": "$1 $2 $3 liegt außerhalb des Üblichen, $4 bis $5 $6",
  "if it is in {}, write {} ({})": "wenn es in $1 ist, $2 ($3) schreiben",
  "correct it, or leave it if it is right": "berichtigen, oder lassen, wenn es stimmt",
  "a rate of {} Hz is unusual": "eine Rate von $1 Hz ist ungewöhnlich",
  "write samples per second (50 is usual)": "Abtastungen je Sekunde schreiben (50 ist üblich)",
  "has a magnitude of {} m/s^2, on Earth it is 9.81": "hat einen Betrag von $1 m/s², auf der Erde sind es 9,81",
  "write the acceleration of gravity in the base frame in m/s^2, as in [0.0, -9.81, 0.0]; zeros if every axis is vertical":
    "die Fallbeschleunigung im Basissystem in m/s² schreiben, etwa [0.0, -9.81, 0.0]; Nullen, wenn jede Achse senkrecht steht",
  "a supply pressure of": "ein Versorgungsdruck von",
  "a flow of": "ein Volumenstrom von",
  "a length of": "eine Länge von",
  "a speed of": "eine Geschwindigkeit von",
  "an acceleration of": "eine Beschleunigung von",
  "a bore of": "eine Bohrung von",
  "a stroke of": "ein Hub von",
  "a coordinate of": "eine Koordinate von",
  "a lever arm of": "ein Hebelarm von",
  "an angle of {} rad is more than a turn": "ein Winkel von $1 rad ist mehr als eine Umdrehung",
  "if it is in degrees, write {} (rad)": "wenn er in Grad ist, $1 (rad) schreiben",
  "is {} rad from a quarter turn, which makes parameters formally independent that nothing can tell":
    "liegt $1 rad neben einer Vierteldrehung; das macht Parameter formal unabhängig, die nichts trennen kann",
  "write {} if that is meant": "$1 schreiben, wenn das gemeint ist",
  "{} to {} rad is more than a turn to one side": "$1 bis $2 rad ist mehr als eine Umdrehung nach einer Seite",
  "if they are in degrees, write [{}, {}]": "wenn sie in Grad sind, [$1, $2] schreiben",
  "{} to {} m is long": "$1 bis $2 m ist lang",
  "if they are in mm, write [{}, {}]": "wenn sie in mm sind, [$1, $2] schreiben",
  "the joint moves by {} {} only": "das Gelenk bewegt sich nur um $1 $2",
  "write its whole range in {}": "seinen ganzen Bereich in $1 schreiben",
  "the rod is {} of the bore; cylinders are built with 0.2 to 0.95":
    "die Stange hat $1 der Bohrung; gebaut werden Zylinder mit 0,2 bis 0,95",
  "correct rod or bore (diameters, in m)": "rod oder bore berichtigen (Durchmesser, in m)",
  "the stroke is {} bores; 0.2 to 60 are built": "der Hub hat $1 Bohrungen; gebaut werden 0,2 bis 60",
  "correct stroke or bore (in m)": "stroke oder bore berichtigen (in m)",
  "{} kg is {} times a steel rod and piston of this size":
    "$1 kg ist das $2-Fache von Stange und Kolben aus Stahl in dieser Größe",
  "correct it, or leave it out: it is then identified": "berichtigen oder weglassen: dann wird es identifiziert",
  "pin to pin {} m with the piston in, for a stroke of {} m":
    "von Bolzen zu Bolzen $1 m bei eingefahrenem Kolben, für einen Hub von $2 m",
  "write the distance of the pins with the piston fully in, in m":
    "den Abstand der Bolzen bei ganz eingefahrenem Kolben schreiben, in m",
  "moves the piston over {} % of its stroke only": "bewegt den Kolben nur über $1 % seines Hubs",
  "correct the limits, the stroke or the linkage's lengths":
    "die Grenzen, den Hub oder die Längen der Koppelkinematik berichtigen",
  "a {} linkage turns a joint, and this one slides": "$1 dreht ein Gelenk, und dieses schiebt",
  "use type: direct": "type: direct nehmen",
  "a direct cylinder moves a sliding joint, and this one turns":
    "ein direkter Zylinder bewegt ein Schubgelenk, und dieses dreht",
  "use three_pin, pins, four_bar or rack": "three_pin, pins, four_bar oder rack nehmen",
  "comes near a dead centre: the lever arm falls to {} mm of {} mm":
    "kommt nahe an einen Totpunkt: Der Hebelarm fällt auf $1 mm von $2 mm",
  "narrow the limits, or correct the linkage": "die Grenzen enger setzen oder die Koppelkinematik berichtigen",
  "moves the piston at {} m/s; seals are made for 0.5 to 1 m/s":
    "bewegt den Kolben mit $1 m/s; Dichtungen sind für 0,5 bis 1 m/s gemacht",
  "correct it (rad/s), or the linkage's lengths": "berichtigen (rad/s), oder die Längen der Koppelkinematik",
  "{} m is {} times the other cylinders' bore": "$1 m ist das $2-Fache der Bohrung der anderen Zylinder",
  "look for a slipped decimal point": "nach einem verrutschten Dezimalpunkt suchen",
  "noise of {} {} is more than a tenth of the range": "ein Rauschen von $1 $2 ist mehr als ein Zehntel des Bereichs",
  "write the standard deviation in {}": "die Standardabweichung in $1 schreiben",
  "ends at {} bar; hydraulic transducers end between 5 and 1500":
    "endet bei $1 bar; hydraulische Aufnehmer enden zwischen 5 und 1500",
  "write the range in {}, or correct the unit": "den Bereich in $1 schreiben oder die Einheit berichtigen",
  "covers {} % of the joint's limits: every value beyond it counts as saturated":
    "deckt $1 % der Grenzen des Gelenks: Jeder Wert darüber hinaus zählt als gesättigt",
};
