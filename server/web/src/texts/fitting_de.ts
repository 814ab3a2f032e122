/**
 * German for what a job of fitting or of an excitation ends with, and for what is wrong with a value that was sent.
 *
 * `tests/server/platform/test_page_texts.py` reads the sentences out of the Python sources, as for refusals.
 */

/** What is wrong with a value (`daq/validation_words.py`). */
const VALIDATION: Record<string, string> = {
  "this key is missing": "dieser Eintrag fehlt",
  "unknown key; remove it": "unbekannter Eintrag; ihn entfernen",
  "must be a text": "muss ein Text sein",
  "must be a text in Unicode": "muss ein Text in Unicode sein",
  "must have {} characters or more": "muss $1 Zeichen haben oder mehr",
  "must have {} characters or fewer": "darf nicht mehr als $1 Zeichen haben",
  "must look like {}": "muss aussehen wie $1",
  "must be a whole number": "muss eine ganze Zahl sein",
  "is too large a number": "ist eine zu große Zahl",
  "must be a number": "muss eine Zahl sein",
  "must be a finite number": "muss eine endliche Zahl sein",
  "must be true or false": "muss true oder false sein",
  "must be greater than {}": "muss größer als $1 sein",
  "must be {} or more": "muss $1 oder mehr sein",
  "must be less than {}": "muss kleiner als $1 sein",
  "must be {} or less": "darf höchstens $1 sein",
  "must be a multiple of {}": "muss ein Vielfaches von $1 sein",
  "must be a list": "muss eine Liste sein",
  "must have {} entries or more": "muss $1 Einträge haben oder mehr",
  "must have {} entries or fewer": "darf nicht mehr als $1 Einträge haben",
  "must have keys and values": "muss aus Einträgen mit Namen und Werten bestehen",
  "must be one of {}": "muss eines hiervon sein: $1",
  "'{}' is none of {}": "„$1“ ist keines von $2",
  "needs the key {}": "braucht den Eintrag $1",
  "must be left out": "muss weggelassen werden",
  "is no JSON that can be read": "ist kein lesbares JSON",
  "must be a time like 2026-01-31T12:00:00Z": "muss eine Zeit sein wie 2026-01-31T12:00:00Z",
  "needs a time zone, as in 2026-01-31T12:00:00Z": "braucht eine Zeitzone, wie in 2026-01-31T12:00:00Z",
};

/** Of an identification: its recordings, its motion, its estimator, its prior, its files. */
const IDENTIFICATION: Record<string, string> = {
  "joints.{}: has no cylinder, so no piston; give it a cylinder or use its angle":
    "joints.$1: hat keinen Zylinder, also keinen Kolben; ihm einen Zylinder geben oder seinen Winkel nehmen",
  "bandwidth {} Hz must be at least {} Hz (six periods in the longest recording) and at most {} Hz (a fifth of the rate)":
    "Die Bandbreite $1 Hz muss mindestens $2 Hz (sechs Perioden in der längsten Aufzeichnung) und darf höchstens $3 Hz sein (ein Fünftel der Rate)",
  "no training recording; give at least one with --train (or --operation)":
    "Keine Aufzeichnung zum Lernen; mindestens eine in der Rolle train oder operation angeben",
  "{}: is the same recording as {} in role {}; validate on another motion":
    "$1 ist dieselbe Aufzeichnung wie $2 in der Rolle $3; an einer anderen Bewegung prüfen",
  "{}: no joint moves, so {}; record while the machine works, or let it follow a motion":
    "$1: Kein Gelenk bewegt sich, also $2; aufzeichnen, während die Maschine arbeitet, oder sie eine Bewegung fahren lassen",
  "{}: this motion does not excite {}; move more joints, or design a motion with 'hilfit excite'":
    "$1: Diese Bewegung regt $2 nicht an; mehr Gelenke bewegen oder mit „hilfit excite“ eine Bewegung entwerfen",
  "this motion tells {} of {} parameters": "diese Bewegung sagt etwas über $1 von $2 Parametern",
  "there is no covariance '{}'; use one of {}": "Eine Kovarianz „$1“ gibt es nicht; eine von $2 nehmen",
  "there is no estimator '{}'; use one of {}": "Einen Schätzer „$1“ gibt es nicht; einen von $2 nehmen",
  "{}: a prior is used by the estimators 'ridge' and 'possible' only":
    "$1: Ein Vorwissen verwenden nur die Schätzer „ridge“ und „possible“",
  "estimator 'ridge' needs a prior: give an earlier report.json or the links from drawings with --prior FILE":
    "Der Schätzer „ridge“ braucht ein Vorwissen: mit --prior DATEI eine frühere report.json oder die Glieder aus Zeichnungen angeben",
  "{}: not a request of an identification ({})": "$1: kein Auftrag einer Identifikation ($2)",
  "{}: {}: {}; it is of another version: remove the directory and run the stages again":
    "$1: $2: $3; die Datei ist von einer anderen Version: das Verzeichnis entfernen und die Stufen noch einmal laufen lassen",
  "there is no stage '{}'; use one of {}": "Eine Stufe „$1“ gibt es nicht; eine von $2 nehmen",
  "{}: is a file; give a directory with -o": "$1 ist eine Datei; mit -o ein Verzeichnis angeben",
  "{}: stage '{}' has not been run; run the stages in order":
    "$1: Die Stufe „$2“ ist nicht gelaufen; die Stufen der Reihe nach laufen lassen",
  "{}: {} cannot be written; choose another directory with -o":
    "$1: $2 lässt sich nicht schreiben; mit -o ein anderes Verzeichnis wählen",
  "{}: {} is a file, so no directory can be made there; choose another with -o":
    "$1: $2 ist eine Datei, also ist dort kein Verzeichnis möglich; mit -o ein anderes wählen",
  "a motion of {} s is shorter than the filters; take {} s or more":
    "Eine Bewegung von $1 s ist kürzer als die Filter; $2 s oder mehr nehmen",
  "{}: cannot be read as YAML or JSON ({})": "$1 ist nicht als YAML oder JSON lesbar ($2)",
  "{}: links.{}.inertia: no body has these moments of inertia about its centre":
    "$1: links.$2.inertia: Kein Körper hat diese Trägheitsmomente um seinen Schwerpunkt",
  "{}: links: {} are given, the machine has {}": "$1: links: angegeben sind $2, die Maschine hat $3",
  "{}: rigid_body.parameters.{} is '{}', this machine's is '{}': the report is of another machine":
    "$1: rigid_body.parameters.$2 ist „$3“, bei dieser Maschine „$4“: Der Bericht ist von einer anderen Maschine",
  "{}: rigid_body.parameters: {} are given, the machine has {}":
    "$1: rigid_body.parameters: angegeben sind $2, die Maschine hat $3",
  "{}: schema is {}; a prior is '{}' or a report, '{}'":
    "$1: schema ist $2; ein Vorwissen ist „$3“ oder ein Bericht, „$4“",
  "{}: cannot write the report: {}; choose another directory":
    "$1: Der Bericht lässt sich nicht schreiben: $2; ein anderes Verzeichnis wählen",
  "report.json: {}: {}; write it as {} says": "report.json: $1: $2; so schreiben, wie $3 es sagt",
  "the report holds a {}, which JSON cannot: give numbers, texts or lists":
    "Der Bericht enthält ein $1, das JSON nicht kennt: Zahlen, Texte oder Listen angeben",
  "{}: no stretch of {} s without a gap; record again or raise the bandwidth":
    "$1: kein Stück von $2 s ohne Lücke; noch einmal aufzeichnen oder die Bandbreite erhöhen",
  "{}: {} has no effort channel; add its pressures, or ask for its valve alone (hilfit valve)":
    "$1: $2 hat keinen Kanal für die Kraftgröße; seine Drücke ergänzen, oder nur nach seinem Ventil fragen (hilfit valve)",
};

/** Of an excitation and its motion file. */
const EXCITATION: Record<string, string> = {
  "joint '{}': has no cylinder, so nothing to unpin; leave it out":
    "Gelenk „$1“ hat keinen Zylinder, also nichts auszuhängen; es weglassen",
  "joint '{}': has no cylinder, so nothing to unpin": "Gelenk „$1“ hat keinen Zylinder, also nichts auszuhängen",
  "joint '{}': {} has {}": "Gelenk „$1“: $2 hat $3",
  "seconds: {} s are too short for a band of {} Hz; take {} s or more":
    "seconds: $1 s sind zu kurz für ein Band von $2 Hz; $3 s oder mehr nehmen",
  "the supply's {} m^3/s are too little for these cylinders at once; move fewer (--joint)":
    "Die $1 m^3/s der Versorgung sind für diese Zylinder auf einmal zu wenig; weniger bewegen (--joint)",
  "use must be in (0, 1], staircase in [0, 0.8], levels and starts 1 or more":
    "use muss über 0 und darf höchstens 1 sein, staircase von 0 bis 0,8, levels und starts 1 oder mehr",
  "{}: no joint has a cylinder, so nothing to unpin; excite it with rods pinned":
    "$1: Kein Gelenk hat einen Zylinder, also nichts auszuhängen; mit eingehängten Stangen anregen",
  "excitation: {} stays at {} of its limit {} {} however small the motion; raise the limit or correct the guess of the parameters":
    "Anregung: $1 bleibt beim $2-fachen seiner Grenze $3 $4, so klein die Bewegung auch ist; die Grenze erhöhen oder die geschätzten Parameter berichtigen",
  "experiment '{}': there are {}": "Versuch „$1“: es gibt $2",
  "{}: has one joint, so no neighbour": "$1 hat ein Gelenk, also keinen Nachbarn",
  "{}: has one joint, so no other pose to hold": "$1 hat ein Gelenk, also keine andere Stellung zu halten",
  "{}: {} {} would reach {} of its limit": "$1: $2 $3 käme auf das $4-fache seiner Grenze",
  "a motion with rods=unpinned tells nothing about the links of {}; leave it out":
    "Eine Bewegung mit rods=unpinned sagt nichts über die Glieder von $1; sie weglassen",
  "{}: was recorded with rods unpinned and tells nothing about the links":
    "$1 wurde mit ausgehängten Stangen aufgezeichnet und sagt nichts über die Glieder",
  "{}: cannot be read ({}); give a motion file (CSV)": "$1 ist nicht lesbar ($2); eine Bewegungsdatei (CSV) angeben",
  "{}: cannot be written ({}); choose another place": "$1 lässt sich nicht schreiben ($2); einen anderen Ort wählen",
  "{}: has {} rows; a motion needs six or more": "$1 hat $2 Zeilen; eine Bewegung braucht sechs oder mehr",
  "{}: is not a text file; give a motion file (CSV)": "$1 ist keine Textdatei; eine Bewegungsdatei (CSV) angeben",
  "{}: no such file; 'hilfit excite' makes one": "$1: diese Datei gibt es nicht; „hilfit excite“ macht eine",
  "{}: time must start at 0, rise by a microsecond or more from row to row, and end within an hour":
    "$1: time muss bei 0 anfangen, von Zeile zu Zeile um mindestens eine Mikrosekunde steigen und innerhalb einer Stunde enden",
  "{}: {} goes from {} to {} {}, beyond its {} to {} {}; make a smaller motion":
    "$1: $2 geht von $3 bis $4 $5, über seine Grenzen $6 bis $7 $8 hinaus; eine kleinere Bewegung machen",
  "{}:1: is a motion of machine '{}', not of '{}'": "$1:1: ist eine Bewegung der Maschine „$2“, nicht von „$3“",
  "{}:1: not a motion file; it must start with '# {} machine=NAME rods=pinned'":
    "$1:1: keine Bewegungsdatei; sie muss anfangen mit „# $2 machine=NAME rods=pinned“",
  "{}:1: rods is {}; it must be pinned or unpinned": "$1:1: rods ist $2; es muss pinned oder unpinned sein",
  "{}:2: column '{}' must end with '{}', because rods=unpinned":
    "$1:2: Die Spalte „$2“ muss auf „$3“ enden, weil rods=unpinned",
  "{}:2: must name 'time' and then one column per joint, each once":
    "$1:2: muss „time“ nennen und dann eine Spalte für jedes Gelenk, jedes einmal",
  "{}:2: there is no joint '{}' on {}": "$1:2: Ein Gelenk „$2“ gibt es an $3 nicht",
  "{}:2: {} has no cylinder, so no piston; remove the column":
    "$1:2: $2 hat keinen Zylinder, also keinen Kolben; die Spalte entfernen",
  "{}:{}: has {} values for {} columns": "$1:$2: hat $3 Werte für $4 Spalten",
  "{}:{}: holds a value that is not finite": "$1:$2: enthält einen Wert, der nicht endlich ist",
  "{}:{}: not numbers: '{}'": "$1:$2: keine Zahlen: „$3“",
  "harmonics must be 2 or more, starts and iterations 1 or more, samples 10 or more":
    "harmonics muss 2 oder mehr sein, starts und iterations 1 oder mehr, samples 10 oder mehr",
  "joints.{}: limits and stroke leave no motion": "joints.$1: Grenzen und Hub lassen keine Bewegung zu",
  "seconds: {} s hold fewer than two periods of {} Hz; take {} s or more":
    "seconds: $1 s enthalten weniger als zwei Perioden von $2 Hz; $3 s oder mehr nehmen",
  "the chosen joints tell no parameter at all; choose others":
    "Die gewählten Gelenke sagen über keinen Parameter etwas; andere wählen",
  "use: {} of the limits; it must be above 0 and at most 1":
    "use: $1 der Grenzen; es muss über 0 und darf höchstens 1 sein",
  "seconds: a level of {} s is too short for a staircase; take more seconds":
    "seconds: Eine Stufe von $1 s ist zu kurz für eine Treppe; mehr Sekunden nehmen",
};

/** Of a model that was read, and what is calculated with it. */
const MODEL: Record<string, string> = {
  "{}: cannot be read ({}); give the model.json of an identification":
    "$1 ist nicht lesbar ($2); die model.json einer Identifikation angeben",
  "{}: has schema {}, this version reads {}; update hilfit":
    "$1 hat das Schema $2, diese Version liest $3; hilfit aktualisieren",
  "{}: is no model; give the model.json of an identification, or the folder it is in":
    "$1 ist kein Modell; die model.json einer Identifikation angeben oder den Ordner, in dem sie ist",
  "{}: is not JSON ({}); give the model.json of an identification":
    "$1 ist kein JSON ($2); die model.json einer Identifikation angeben",
  "{}: no such file; 'hilfit identify' writes it beside report.json":
    "$1: diese Datei gibt es nicht; „hilfit identify“ schreibt sie neben report.json",
  "{}: sha256: the file was changed after it was written; identify again, or delete this key to use the file as it is":
    "$1: sha256: Die Datei wurde geändert, nachdem sie geschrieben war; noch einmal identifizieren oder diesen Schlüssel löschen, um sie zu nehmen, wie sie ist",
  "{}: {}: {} is not known here; install the package that has this effect":
    "$1: $2: $3 ist hier nicht bekannt; das Paket installieren, das diesen Effekt hat",
  "{}: {}: {}; identify again, the file was changed":
    "$1: $2: $3; noch einmal identifizieren, die Datei wurde geändert",
  "compare: the first model is of '{}' ({}), the second of '{}' ({}); give two models of one machine":
    "Vergleich: Das erste Modell ist von „$1“ ($2), das zweite von „$3“ ($4); zwei Modelle einer Maschine angeben",
  "{}: free drives carry no joint effort; give a recording of the arm":
    "$1: Ausgehängte Antriebe tragen keine Gelenkkraft; eine Aufzeichnung des Arms angeben",
  "overload: {} peaks in {} s are too few to learn what is usual; give longer recordings":
    "Überlast: $1 Spitzen in $2 s sind zu wenige, um zu lernen, was üblich ist; längere Aufzeichnungen angeben",
};

/** The sentence of a job's end, or of a value that cannot be used. */
export const FITTING: Record<string, string> = { ...VALIDATION, ...IDENTIFICATION, ...EXCITATION, ...MODEL };
