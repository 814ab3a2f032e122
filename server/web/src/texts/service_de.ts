/** German for sentences that the service writes in English: alarms, and what a job is doing. */
import type { Sentence } from "./sentences";

export const SERVICE_FIXED: Record<string, string> = {
  "its secret is not on this computer: remove the webhook and add it again":
    "Sein Geheimnis ist nicht auf diesem Rechner: den Webhook entfernen und neu anlegen",
  "its address is no longer in webhook_places": "Seine Adresse steht nicht mehr in webhook_places",
  "a constant force more or less": "eine gleichbleibende Kraft mehr oder weniger",
  "more or less force against the motion (friction)": "mehr oder weniger Kraft gegen die Bewegung (Reibung)",
  "a force that grows with the load (a gain, or another load)":
    "eine Kraft, die mit der Last wächst (eine Empfindlichkeit oder eine andere Last)",
  "it is being started": "sie wird gestartet",
  "Waiting for room on the disk": "Wartet auf Platz auf dem Datenträger",
  "Waiting for its turn": "Wartet, bis er an der Reihe ist",
  Done: "Fertig",
  done: "fertig",
  Failed: "Fehlgeschlagen",
  Cancelled: "Abgebrochen",
  "Designing the motion": "Bewegung wird entworfen",
  Recording: "Aufzeichnen",
  "Fitting the new recordings": "Neue Aufzeichnungen werden ausgewertet",
  "Comparing with the active calibration": "Vergleich mit der Kalibrierung in Gebrauch",
  "Proposing the new calibration": "Neue Kalibrierung wird vorgeschlagen",
  "The arm moves to the start of the motion": "Der Arm fährt an den Anfang der Bewegung",
  "Checking recordings and equations": "Aufzeichnungen und Gleichungen werden geprüft",
  "checking recordings and equations": "Aufzeichnungen und Gleichungen werden geprüft",
  "Stage 1: each drive's friction and stiffness": "Stufe 1: Reibung und Steifigkeit jedes Antriebs",
  "stage 1: each drive's friction and stiffness": "Stufe 1: Reibung und Steifigkeit jedes Antriebs",
  "Stage 2: base parameters with the friction frozen": "Stufe 2: Basisparameter bei festgehaltener Reibung",
  "stage 2: base parameters with the friction frozen": "Stufe 2: Basisparameter bei festgehaltener Reibung",
  "Noise floor and kinematic check": "Rauschpegel und Prüfung der Kinematik",
  "noise floor and kinematic check": "Rauschpegel und Prüfung der Kinematik",
  "Tracing the residual to an effect": "Der Restfehler wird auf einen Effekt zurückgeführt",
  "tracing the residual to an effect": "Der Restfehler wird auf einen Effekt zurückgeführt",
  "Refitting both stages jointly": "Beide Stufen werden gemeinsam neu angepasst",
  "refitting both stages jointly": "Beide Stufen werden gemeinsam neu angepasst",
  "Writing the report": "Der Bericht wird geschrieben",
  "writing the report": "Der Bericht wird geschrieben",
  checking: "Prüfung",
  "checking the equations of motion against themselves": "Die Bewegungsgleichungen werden an sich selbst geprüft",
  "one-shot regression for comparison": "Regression in einem Schritt zum Vergleich",
  "interval of the improvement": "Vertrauensbereich der Verbesserung",
  "designing the experiment that tells rivals apart": "Der Versuch, der die Möglichkeiten trennt, wird entworfen",
  "looking again with another bandwidth": "Suche mit einer anderen Bandbreite",
  "searching shapes on all samples": "Formen werden auf allen Abtastwerten gesucht",
  "refitting what was found on all samples": "Das Gefundene wird auf allen Abtastwerten neu angepasst",
};

export const SERVICE_SENTENCES: readonly Sentence[] = [
  [
    /^little disk is free; recordings end below (.+) MiB: delete some or make room$/,
    "Der Datenträger ist fast voll; unter $1 MiB enden Aufzeichnungen: einige löschen oder Platz schaffen",
  ],
  [
    /^the disk is full: less than (.+) MiB are free, recordings have ended; make room$/,
    "Der Datenträger ist voll: weniger als $1 MiB sind frei, Aufzeichnungen sind beendet; Platz schaffen",
  ],
  [/^acquisition does not run: (.+)$/, "Die Erfassung läuft nicht: $1"],
  [
    /^no measurement from (.+); check the sensor and its cable$/,
    "Keine Messung von $1; den Aufnehmer und sein Kabel prüfen",
  ],
  [
    /^the computer's clock was set by (.+) s; times in lists before and after do not compare$/,
    "Die Uhr des Rechners wurde um $1 s gestellt; Zeiten davor und danach sind nicht vergleichbar",
  ],
  [/^the receiver answered (\d+)$/, "Der Empfänger antwortete mit $1"],
  [/^no answer \((.+)\)$/, "Keine Antwort ($1)"],
  [
    /^(\S+) resolves to addresses that webhook_places does not let through$/,
    "$1 führt zu Adressen, die webhook_places nicht zulässt",
  ],
  [
    /^webhook (.+): messages were given up; look at its deliveries and at its receiver$/,
    "Webhook $1: Meldungen wurden aufgegeben; seine Zustellungen und seinen Empfänger ansehen",
  ],
  [
    /^measured and predicted effort drift apart: (.+); recalibrate, or look for the cause$/,
    "Gemessene und vorhergesagte Kraftgröße laufen auseinander: $1; neu kalibrieren oder die Ursache suchen",
  ],
  [
    /^(.+): measured and predicted effort differ by (\S+) (.+), (\S+) times the band \(limit (.+)\): a collision or an overload; look at the arm$/,
    "$1: gemessene und vorhergesagte Kraftgröße unterscheiden sich um $2 $3, das $4-Fache des Bands (Grenze $5): Kollision oder Überlast; den Arm ansehen",
  ],
  [
    /^at (.+) the active calibration leaves more unexplained than when it was made; look at the proposed calibration (.+)$/,
    "Bei $1 lässt die Kalibrierung in Gebrauch mehr unerklärt als bei ihrer Entstehung; die vorgeschlagene Kalibrierung $2 ansehen",
  ],
  [/^reading (.+)$/, "$1 wird gelesen"],
  [/^comparing the position sensors of (.+)$/, "Die Wegaufnehmer von $1 werden verglichen"],
  [/^looking for what is missing, round (\d+)$/, "Suche nach dem, was fehlt, Runde $1"],
  [/^Recording again: (.+)$/, "Neue Aufzeichnung: $1"],
  [/^Recording (\S+) for (\d+) s$/, "Aufzeichnung ($1) von $2 s"],
  [/^Waiting for a person until (.+) UTC: (.+)$/, "Wartet bis $1 UTC auf eine Person: $2"],
  [
    /^load the motion of (.+) into the arm's controller, and record it as (.+)$/,
    "Die Bewegung von $1 in die Steuerung des Arms laden und als $2 aufzeichnen",
  ],
  [/^Waiting: (.+)$/, "Wartet: $1"],
  [/^(.+): failed$/, "$1: fehlgeschlagen"],
];
