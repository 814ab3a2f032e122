/**
 * German for what the service refuses, by the English sentence: `{}` stands for a value, `$1` for the first of them.
 *
 * `tests/server/platform/test_page_texts.py` reads the sentences out of the Python sources: each of them is here, and
 * nothing else is.
 */

import { FITTING } from "./fitting_de";

/** What stands in sentences as a value: states, roles, kinds of things. */
export const VALUES: Record<string, string> = {
  identification: "Identifikation",
  valve: "Ventile",
  proposed: "vorgeschlagen",
  approved: "freigegeben",
  rejected: "abgelehnt",
  active: "in Gebrauch",
  retired: "außer Gebrauch",
  queued: "in der Warteschlange",
  running: "läuft",
  failed: "fehlgeschlagen",
  cancelled: "abgebrochen",
  recording: "in Aufnahme",
  sealed: "abgeschlossen",
  starting: "wird gestartet",
  disabled: "ausgeschaltet",
  "its identification failed": "ihre Identifikation ist fehlgeschlagen",
  "the machine is not acquired at the moment": "die Maschine wird gerade nicht erfasst",
  "the machine has no active calibration": "die Maschine hat keine Kalibrierung in Gebrauch",
  "the machine has no active calibration of its valves":
    "die Maschine hat keine Kalibrierung ihrer Ventile in Gebrauch",
  "the monitor failed unexpectedly; the log of the service says why":
    "die Überwachung ist unerwartet fehlgeschlagen; das Protokoll des Dienstes sagt, warum",
  "too many headers": "zu viele Kopfzeilen",
  "the effort": "die Kraftgröße",
  viewer: "Zuschauer",
  operator: "Bediener",
  engineer: "Ingenieur",
  device: "Gerät",
  token: "Schlüssel",
  machine: "Maschine",
};

/** Of requests, of what they name, and of the state of the service. */
const SERVICE: Record<string, string> = {
  "'{}' is none of {}; export the recording as one of them": "„$1“ ist keines von $2; die Aufzeichnung so exportieren",
  "'{}' is of machine '{}', '{}' of '{}'; take one machine":
    "„$1“ gehört zur Maschine „$2“, „$3“ zu „$4“; beide von einer Maschine nehmen",
  "'{}' and '{}' are not of the same: one is of valves; take two of a kind":
    "„$1“ und „$2“ sind nicht von derselben Art: Eine ist von Ventilen; zwei von einer Art nehmen",
  "'{}': this service reads no MDF4 (hilfit[export] is not installed); upload .csv or .parquet":
    "„$1“: Dieser Dienst liest kein MDF4 (hilfit[export] ist nicht installiert); .csv oder .parquet hochladen",
  "DBC files: could not be read; {}; try again":
    "Die DBC-Dateien konnten nicht gelesen werden; $1; noch einmal versuchen",
  "DBC files: take too long to read; export them with fewer messages":
    "Die DBC-Dateien zu lesen dauert zu lange; mit weniger Botschaften exportieren",
  "DBC files: {}": "DBC-Dateien: $1",
  "The design left no motion that can be read; order it again":
    "Der Entwurf hat keine lesbare Bewegung hinterlassen; noch einmal entwerfen lassen",
  "The last stage left no report that can be read": "Die letzte Stufe hat keinen lesbaren Bericht hinterlassen",
  "a law of the time since the last reversal needs more of the past than is looked at at a time":
    "ein Gesetz über die Zeit seit der letzten Umkehr braucht mehr Vergangenheit, als jeweils betrachtet wird",
  "alarm '{}' has changed meanwhile; read it again": "Der Alarm „$1“ hat sich inzwischen geändert; ihn neu laden",
  "calibration '{}' changed since you read it; read it again":
    "Die Kalibrierung „$1“ hat sich geändert, seit sie geladen wurde; sie neu laden",
  "calibration '{}' is {}; it has to be approved before it is used":
    "Die Kalibrierung „$1“ hat den Zustand: $2; vor dem Gebrauch muss sie freigegeben werden",
  "calibration '{}' is {}; only a proposed one can be {}":
    "Die Kalibrierung „$1“ hat den Zustand: $2; nur eine vorgeschlagene kann werden: $3",
  "calibration '{}' is {}; only the one in use can be taken out of use":
    "Die Kalibrierung „$1“ hat den Zustand: $2; außer Gebrauch nehmen lässt sich nur die in Gebrauch",
  "calibration '{}' was proposed by you; a second person has to approve it":
    "Die Kalibrierung „$1“ ist von Ihnen vorgeschlagen; freigeben muss sie eine zweite Person",
  "channel '{}': machine '{}' has none of that name": "Die Maschine „$2“ hat keinen Kanal „$1“",
  "channel '{}': recording '{}' has none of that name": "Die Aufzeichnung „$2“ hat keinen Kanal „$1“",
  "cron '{}' cannot be read; write minute hour day month weekday, like '30 2 * * 1'":
    "Der Cron-Ausdruck „$1“ ist nicht lesbar; Minute Stunde Tag Monat Wochentag schreiben, etwa „30 2 * * 1“",
  "cron '{}' comes more often than every {} minutes; hourly is '0 * * * *'":
    "Der Cron-Ausdruck „$1“ kommt öfter als alle $2 Minuten; stündlich ist „0 * * * *“",
  "cron '{}' never comes; check its day and month": "Der Cron-Ausdruck „$1“ kommt nie; Tag und Monat prüfen",
  "excitation '{}' has no motion: its job {} is {}": "Die Anregung „$1“ hat keine Bewegung: Ihr Auftrag $2 ist: $3",
  "excitation '{}' is not designed yet; wait for its job {}":
    "Die Anregung „$1“ ist noch nicht entworfen; auf ihren Auftrag $2 warten",
  "excitation '{}' is of machine '{}', not of '{}'": "Die Anregung „$1“ gehört zur Maschine „$2“, nicht zu „$3“",
  "identification '{}' designed no next experiment: nothing was left to be told apart":
    "Die Identifikation „$1“ hat keinen weiteren Versuch entworfen: Es war nichts mehr zu trennen",
  "its identification {} was cancelled; run the schedule again":
    "Ihre Identifikation $1 wurde abgebrochen; den Zeitplan noch einmal ausführen",
  "bus '{}': {}": "Bus „$1“: $2",
  "machine '{}' cannot be acquired: its bus '{}' leads to {}, which is not in bus_places; have the administrator of this service add it to the file of --config":
    "Die Maschine „$1“ lässt sich nicht erfassen: Ihr Bus „$2“ führt zu $3, und das steht nicht in bus_places; vom Verwalter des Dienstes in die Datei von --config eintragen lassen",
  "{} is not in webhook_places; have it added to the file of --config":
    "$1 steht nicht in webhook_places; in die Datei von --config eintragen lassen",
  "there is a machine '{}' already, which reads like '{}'; choose another name":
    "Es gibt schon eine Maschine „$1“, die sich wie „$2“ liest; einen anderen Namen wählen",
  "the request was cut off; send it again": "Die Anfrage brach ab; sie noch einmal senden",
  "the store is damaged ({}); restore a backup": "Die Datenbank ist beschädigt ($1); eine Sicherung zurückspielen",
  "machine '{}' cannot be acquired: {} in its file; add it and upload it again":
    "Die Maschine „$1“ lässt sich nicht erfassen: $2 in ihrer Datei; ergänzen und neu hochladen",
  "machine '{}' drifts and no enabled schedule says how to recalibrate it; make one":
    "Die Maschine „$1“ driftet, und kein eingeschalteter Zeitplan sagt, wie sie neu kalibriert wird; einen anlegen",
  "machine '{}' had no other calibration in use before; activate one instead":
    "Für die Maschine „$1“ war vorher keine andere Kalibrierung in Gebrauch; stattdessen eine in Gebrauch nehmen",
  "machine '{}' has been acquired for less than {} s; try again when it has":
    "Die Maschine „$1“ wird erst seit weniger als $2 s erfasst; danach noch einmal versuchen",
  "machine '{}' has no cylinder, so there is nothing to unpin; use rods 'pinned'":
    "Die Maschine „$1“ hat keinen Zylinder, also ist nichts auszuhängen; rods: pinned nehmen",
  "machine '{}' has no joint '{}'; it has {}": "Die Maschine „$1“ hat kein Gelenk „$2“; sie hat $3",
  "machine '{}' has not sent a frame yet; try again":
    "Von der Maschine „$1“ kam noch kein Messwert; noch einmal versuchen",
  "machine '{}' has version {} by now, not {}; read it and put both changes together":
    "Die Maschine „$1“ hat inzwischen Version $2, nicht $3; neu laden und beide Änderungen zusammenführen",
  "machine '{}' is a real one: download motion.csv and load it into the arm's own controller":
    "Die Maschine „$1“ ist eine wirkliche: motion.csv herunterladen und in die Steuerung des Arms laden",
  "machine '{}' is being recalibrated by {}; wait for it or cancel it":
    "Die Maschine „$1“ wird gerade von $2 neu kalibriert; das abwarten oder abbrechen",
  "machine '{}' is being recorded already as {}; stop that one first":
    "Die Maschine „$1“ wird schon als $2 aufgezeichnet; diese Aufzeichnung zuerst beenden",
  "machine '{}' is being recorded as {}; stop that recording first":
    "Die Maschine „$1“ wird gerade als $2 aufgezeichnet; diese Aufzeichnung zuerst beenden",
  "machine '{}' is not being acquired; enable its acquisition":
    "Die Maschine „$1“ wird nicht erfasst; ihre Erfassung einschalten",
  "machine '{}' is not simulated here; only one of `hilfit serve --simulate` can be broken":
    "Die Maschine „$1“ wird hier nicht simuliert; nur eine von `hilfit serve --simulate` kann gestört werden",
  "machine '{}' is the one that this service simulates: with another file it would look for its buses elsewhere, and be acquired no more. Recordings of it can be uploaded as they are; for a machine of your own change name: in the file, or serve without --simulate":
    "Die Maschine „$1“ ist die, die dieser Dienst simuliert: Mit einer anderen Datei suchte er ihre Busse anderswo und erfasste sie nicht mehr. Aufzeichnungen von ihr lassen sich hochladen, wie sie sind; für eine eigene Maschine name: in der Datei ändern oder den Dienst ohne --simulate starten",
  "machines: there is no machine '{}'; upload its machine file first":
    "Es gibt keine Maschine „$1“; zuerst ihre Maschinendatei hochladen",
  "no frame came within {} s; check the buses of the machine":
    "In $1 s kam kein Messwert; die Busse der Maschine prüfen",
  "no open pairing code is this one; type it again, or ask an admin for a new one":
    "Keiner der offenen Kopplungscodes lautet so; noch einmal eintippen oder einen Admin um einen neuen bitten",
  "pair this device first, or send 'Authorization: Bearer' with a valid token":
    "Dieses Gerät zuerst koppeln oder „Authorization: Bearer“ mit einem gültigen Schlüssel senden",
  "recording '{}' is no longer there; choose another one":
    "Die Aufzeichnung „$1“ ist nicht mehr da; eine andere wählen",
  "recording '{}' is of machine '{}', not of '{}'": "Die Aufzeichnung „$1“ gehört zur Maschine „$2“, nicht zu „$3“",
  "recording '{}' is still being recorded; stop it first": "Die Aufzeichnung „$1“ läuft noch; sie zuerst beenden",
  "recording '{}' is the data of {}; it has to stay":
    "Die Aufzeichnung „$1“ gehört zu den Daten von $2; sie muss bleiben",
  "recording '{}' is there twice; give each recording once":
    "Die Aufzeichnung „$1“ kommt doppelt vor; jede nur einmal angeben",
  "recording '{}' is {}; only a sealed recording can be used":
    "Die Aufzeichnung „$1“ hat den Zustand: $2; verwenden lässt sich nur eine abgeschlossene",
  "recording '{}' is {}; there is no whole file to read":
    "Die Aufzeichnung „$1“ hat den Zustand: $2; es gibt keine ganze Datei zu lesen",
  "recording '{}' is {}; there is nothing to stop":
    "Die Aufzeichnung „$1“ hat den Zustand: $2; da ist nichts zu beenden",
  "recording '{}': role '{}' is unknown; use one of {}":
    "Aufzeichnung „$1“: Die Rolle „$2“ ist unbekannt; eine von diesen nehmen: $3",
  "recording '{}': {}: fewer than 16 rows without a gap; choose a longer part":
    "Aufzeichnung „$1“, $2: weniger als 16 Zeilen ohne Lücke; einen längeren Teil wählen",
  "{} of '{}' cannot be read ({}); fit it again": "$1 von „$2“ ist nicht lesbar ($3); noch einmal identifizieren",
  "role '{}' is unknown; use one of {}": "Die Rolle „$1“ ist unbekannt; eine von diesen nehmen: $2",
  "storage_url {}: {} cannot be reached ({}); mend the way there":
    "storage_url $1: $2 ist nicht erreichbar ($3); den Weg dorthin in Ordnung bringen",
  "{} at {} is not what was stored (its SHA-256 differs); order again":
    "$1 bei $2 ist nicht, was dort abgelegt wurde (seine SHA-256 ist eine andere); noch einmal bestellen",
  "schedule '{}' was changed meanwhile; read it again": "Der Zeitplan „$1“ wurde inzwischen geändert; ihn neu laden",
  "somebody replaced {} meanwhile; look at it, and send yours again":
    "Jemand hat $1 inzwischen ersetzt; ansehen und die eigene Datei noch einmal senden",
  "the acquisition process ended by itself; it is started again":
    "Der Prozess der Erfassung endete von selbst; er wird neu gestartet",
  "the data directory cannot be used ({}); put it right":
    "Das Datenverzeichnis ist nicht verwendbar ($1); in Ordnung bringen",
  "the data directory is another one than at the start; restart the service":
    "Das Datenverzeichnis ist ein anderes als beim Start; den Dienst neu starten",
  "the disk is full: {} MiB are free, {} MiB are to come and {} MiB are kept for the database; delete recordings or make room":
    "Der Datenträger ist voll: $1 MiB sind frei, $2 MiB sollen kommen, $3 MiB bleiben der Datenbank; Aufzeichnungen löschen oder Platz schaffen",
  "the file of machine '{}' is gone; upload it again":
    "Die Datei der Maschine „$1“ ist verschwunden; sie noch einmal hochladen",
  "the file of machine '{}' names no DBC file of this name; add it to a bus's dbc":
    "Die Datei der Maschine „$1“ nennt keine DBC-Datei dieses Namens; bei einem Bus unter dbc eintragen",
  "the file of recording '{}' is gone; record or upload it again":
    "Die Datei der Aufzeichnung „$1“ ist verschwunden; noch einmal aufzeichnen oder hochladen",
  "the file's name does not end in {}; name it so in dbc":
    "Der Dateiname endet nicht auf $1; die Datei unter dbc so nennen",
  "the machine file has no command of {} any more; identify with the present file":
    "Die Maschinendatei hat keinen Stellwert von $1 mehr; mit der jetzigen Datei identifizieren",
  "valve.json of the calibration cannot be read ({}); identify again":
    "valve.json der Kalibrierung ist nicht lesbar ($1); noch einmal identifizieren",
  "{}: pressures that its valve was identified with are no longer measured; identify with the present file":
    "$1: Drücke, mit denen sein Ventil identifiziert wurde, werden nicht mehr gemessen; mit der jetzigen Datei identifizieren",
  "{}: its warming up follows a recording's clock; add a channel oil_temperature":
    "$1: Das Warmwerden folgt der Uhr einer Aufzeichnung; einen Kanal oil_temperature ergänzen",
  "the machine file has no channel {} any more, which the calibration was fitted on; identify with the present file":
    "Die Maschinendatei hat den Kanal $1 nicht mehr, mit dem die Kalibrierung gewonnen wurde; mit der jetzigen Datei identifizieren",
  "the model does not say what residuals are usual; identify on longer recordings":
    "Das Modell sagt nicht, welche Restfehler üblich sind; mit längeren Aufzeichnungen identifizieren",
  "the model of the identification cannot be read ({}); identify again":
    "Das Modell der Identifikation ist nicht lesbar ($1); noch einmal identifizieren",
  "the schedule names no excitation for its standard motion; add one to it":
    "Der Zeitplan nennt keine Anregung für seine Standardbewegung; eine eintragen",
  "the service is busy with the files of others; try again in a few seconds":
    "Der Dienst ist mit den Dateien anderer beschäftigt; in ein paar Sekunden noch einmal versuchen",
  "the simulated controller refused the motion: {}": "Die simulierte Steuerung hat die Bewegung abgelehnt: $1",
  "the simulated machine does not answer; restart the service":
    "Die simulierte Maschine antwortet nicht; den Dienst neu starten",
  "the simulated machine does not run; restart the service":
    "Die simulierte Maschine läuft nicht; den Dienst neu starten",
  "the simulated machine's controller does not answer; restart the service":
    "Die Steuerung der simulierten Maschine antwortet nicht; den Dienst neu starten",
  "the standard motion needs excitations: give the id of one or two that were designed":
    "Die Standardbewegung braucht Anregungen: eine oder zwei entworfene angeben",
  "the store cannot be read; the log of the service says why":
    "Die Datenbank ist nicht lesbar; das Protokoll des Dienstes sagt, warum",
  "the store's file is gone; restore a backup and restart the service":
    "Die Datei der Datenbank ist verschwunden; eine Sicherung einspielen und den Dienst neu starten",
  "the upload cannot be stored ({}); free some space":
    "Das Hochgeladene lässt sich nicht speichern ($1); Platz schaffen",
  "the upload cannot be stored ({}); free some space and try again":
    "Das Hochgeladene lässt sich nicht speichern ($1); Platz schaffen und noch einmal versuchen",
  "the upload is larger than {} bytes; split it or raise maximum_upload_bytes":
    "Das Hochgeladene hat mehr als $1 Bytes; teilen oder maximum_upload_bytes erhöhen",
  "there is no alarm '{}'": "Es gibt keinen Alarm „$1“",
  "there is no calibration '{}'": "Es gibt keine Kalibrierung „$1“",
  "there is no effect '{}'; read the list of effects": "Es gibt keinen Effekt „$1“; die Liste der Effekte nennt alle",
  "there is no excitation '{}'": "Es gibt keine Anregung „$1“",
  "there is no file {} beside the file of machine '{}'; upload it":
    "Neben der Datei der Maschine „$2“ gibt es keine Datei $1; sie hochladen",
  "there is no identification '{}'": "Es gibt keine Identifikation „$1“",
  "there is no job '{}'": "Es gibt keinen Auftrag „$1“",
  "there is no webhook '{}'": "Es gibt keinen Webhook „$1“",
  "there is no machine '{}' for you; ask an admin to bind you to it":
    "Für Sie gibt es keine Maschine „$1“; einen Admin bitten, sie Ihnen zuzuordnen",
  "there is no recalibration '{}'": "Es gibt keine Neukalibrierung „$1“",
  "there is no recording '{}'": "Es gibt keine Aufzeichnung „$1“",
  "there is no recording in the role '{}'; record one and give its id":
    "Es gibt keine Aufzeichnung in der Rolle „$1“; eine aufnehmen und angeben",
  "there is no schedule '{}'": "Es gibt keinen Zeitplan „$1“",
  "there is no {} '{}'": "$1 „$2“ gibt es nicht",
  "there is no {} '{}' for '{}'": "$1 „$2“ gibt es für „$3“ nicht",
  "there is no {}; upload its machine file": "Es gibt sie nicht: $1; ihre Maschinendatei hochladen",
  "this Idempotency-Key came before with another request; use a new key":
    "Dieser Idempotency-Key kam schon mit einer anderen Anfrage; einen neuen nehmen",
  "this is about all machines, '{}' is bound to some of them":
    "Das betrifft alle Maschinen, „$1“ ist nur einigen zugeordnet",
  "this needs the role {}, '{}' is {}; ask an admin for a pairing code of that role":
    "Das braucht die Rolle $1, „$2“ hat die Rolle $3; einen Admin um einen Kopplungscode dieser Rolle bitten",
  "timezone '{}' is unknown; write one like Europe/Vienna or UTC":
    "Die Zeitzone „$1“ ist unbekannt; eine wie Europe/Vienna oder UTC schreiben",
  "too many requests; try again in {} s": "zu viele Anfragen; in $1 s noch einmal versuchen",
  "until {} UTC {}": "bis $1 UTC $2",
  "whoever is at this computer has no session that could be ended":
    "Wer an diesem Rechner sitzt, hat keine Sitzung, die sich beenden ließe",
  "{} '{}' is the last admin; pair another one before removing it":
    "$1 „$2“ ist der letzte Admin; vor dem Entfernen einen anderen koppeln",
  "{} acts in single recordings of the fit; the calibration says nothing of now":
    "$1 wirkt nur in einzelnen Aufzeichnungen der Anpassung; die Kalibrierung sagt nichts über jetzt",
  "{} needs what live signals do not tell (the recording's clock, or pressures that are not measured); this calibration cannot be watched":
    "$1 braucht, was laufende Signale nicht sagen (die Uhr der Aufzeichnung oder Drücke, die nicht gemessen werden); diese Kalibrierung lässt sich nicht überwachen",
  "{} of your requests of this kind are under way; try again when one is done":
    "$1 Ihrer Anfragen dieser Art sind in Arbeit; noch einmal versuchen, wenn eine fertig ist",
  "{} pairing codes are open; use one, or wait until they expire":
    "$1 Kopplungscodes sind offen; einen verwenden oder warten, bis sie ablaufen",
  "{}, {} times over; check the machine and run the schedule again":
    "$1, das $2-mal; die Maschine prüfen und den Zeitplan noch einmal ausführen",
  "{}: cannot be read; export it again": "$1 ist nicht lesbar; noch einmal exportieren",
  "{}: could not be read; {}; try again": "$1 konnte nicht gelesen werden; $2; noch einmal versuchen",
  "{}: could not be written as {}; {}": "$1 konnte nicht als $2 geschrieben werden; $3",
  "{}: has gaps, so calibrations cannot be compared by it; record again":
    "$1 hat Lücken, Kalibrierungen lassen sich damit nicht vergleichen; neu aufzeichnen",
  "{}: has no rows from {} s to {} s; choose a part that it has":
    "$1 hat keine Zeilen von $2 s bis $3 s; einen Teil wählen, den es gibt",
  "{}: is too short to compare calibrations by; record a minute at least":
    "$1 ist zu kurz, um Kalibrierungen damit zu vergleichen; mindestens eine Minute aufzeichnen",
  "{}: looking at it failed; {}": "$1 anzusehen ist fehlgeschlagen; $2",
  "{}: takes too long to read; make it shorter": "$1 zu lesen dauert zu lange; kürzen",
  "{}: needs too much memory; record or export a shorter one":
    "$1 braucht zu viel Speicher; eine kürzere aufzeichnen oder exportieren",
  "{}; design the excitation first and name it in the schedule":
    "$1; zuerst die Anregung entwerfen und im Zeitplan nennen",
  "the new calibration leaves {} % less unexplained": "Die neue Kalibrierung lässt $1 % weniger unerklärt",
  "the new calibration leaves {} % more unexplained": "Die neue Kalibrierung lässt $1 % mehr unerklärt",
  "the body is no JSON that can be read": "Der Inhalt der Anfrage ist kein lesbares JSON",
  "there is nothing at {}; the resources are listed in openapi.json":
    "Bei $1 ist nichts; was es gibt, steht in openapi.json",
  "{} is not possible here; see the header Allow": "$1 ist hier nicht möglich; siehe Kopfzeile Allow",
  "the store is busy, full, read-only or gone; try again, and see the log of the service":
    "Die Datenbank ist beschäftigt, voll, schreibgeschützt oder verschwunden; noch einmal versuchen und ins Protokoll des Dienstes sehen",
  "recording '{}' has ended, its rows are safe, and it is sealed as soon as disk and store take it; make room":
    "Die Aufzeichnung „$1“ ist zu Ende, ihre Zeilen sind sicher, und sie wird abgeschlossen, sobald Datenträger und Datenbank sie nehmen; Platz schaffen",
  "recording failed unexpectedly; the log of the service says why":
    "Die Aufzeichnung ist unerwartet fehlgeschlagen; das Protokoll des Dienstes sagt, warum",
  "the disk is full; make room": "Der Datenträger ist voll; Platz schaffen",
  "the data directory cannot be used; the log says why":
    "Das Datenverzeichnis ist nicht verwendbar; das Protokoll sagt, warum",
  "a text in the request is not Unicode; correct it": "Ein Text der Anfrage ist kein Unicode; berichtigen",
  "the service failed on this request; its log says why":
    "Der Dienst ist an dieser Anfrage gescheitert; sein Protokoll sagt, warum",
  "the request is larger than {} bytes, the most that is taken here":
    "Die Anfrage hat mehr als $1 Bytes, so viel wird hier höchstens angenommen",
  "'{}' is no name of this service; reach it by its address, or list it in public_hosts":
    "„$1“ ist kein Name dieses Dienstes; ihn über seine Adresse ansprechen oder den Namen unter public_hosts eintragen",
  "requests are taken from programs and from pages of this service only":
    "Anfragen werden nur von Programmen und von Seiten dieses Dienstes angenommen",
};

/** Of files of recordings, as they are read. */
const RECORDINGS: Record<string, string> = {
  "{}: schema is '{}'; this version reads 'hilfit/recording/1'":
    "$1: schema ist „$2“; diese Version liest „hilfit/recording/1“",
  "{}: is a recording of machine '{}', not of '{}'; give the machine file of '{}'":
    "$1 ist eine Aufzeichnung der Maschine „$2“, nicht von „$3“; die Maschinendatei von „$4“ angeben",
  "{}: was recorded as '{}' and cannot serve as '{}'; give it as {}":
    "$1 wurde als „$2“ aufgezeichnet und kann nicht als „$3“ dienen; als $4 angeben",
  "{}: has no column 'time' (s){}; add it as the first column":
    "$1 hat keine Spalte „time“ (s)$2; als erste Spalte einfügen",
  "{}: its columns ({}) do not tell which channels of '{}' ({}) they are; say it with --map":
    "$1: Die Spalten ($2) sagen nicht, welche Kanäle von „$3“ ($4) sie sind; mit --map angeben, welche Spalte welcher Kanal ist",
  "{}: has another machine's channels ({}); '{}' has {}; give the machine file that it was recorded with":
    "$1 hat die Kanäle einer anderen Maschine ($2); „$3“ hat $4; die Maschinendatei angeben, mit der aufgezeichnet wurde",
  "{}: {}: this channel is missing{}; record all channels of '{}', or remove it from the machine file":
    "$1: Der Kanal $2 fehlt$3; alle Kanäle von „$4“ aufzeichnen oder ihn aus der Maschinendatei nehmen",
  "{}: {}: '{}' has no such channel{}; remove the column, or add the channel to the machine file":
    "$1: „$3“ hat keinen Kanal $2$4; die Spalte entfernen oder den Kanal in die Maschinendatei aufnehmen",
  "{}: time: row {} is not a number; cut the row out": "$1: time: Zeile $2 ist keine Zahl; die Zeile herausschneiden",
  "{}: time: does not increase at row {} ({} s after {} s); sort the rows, or split the file there":
    "$1: time: nimmt in Zeile $2 nicht zu ($3 s nach $4 s); die Zeilen sortieren oder die Datei dort teilen",
  "{}: time: sampled at {} Hz, the machine file says rate_hz {}; {}":
    "$1: time: abgetastet mit $2 Hz, die Maschinendatei sagt rate_hz $3; $4",
  "{}: time: {} of {} steps are not 1/{} s, the first after row {} ({} s to {} s); add the lost rows marked missing, split the file, or give --resample if the logger's clock is uneven":
    "$1: time: $2 von $3 Schritten sind nicht 1/$4 s, der erste nach Zeile $5 ($6 s bis $7 s); die verlorenen Zeilen als fehlend einfügen, die Datei teilen oder, wenn die Uhr des Loggers ungleichmäßig geht, --resample angeben",
  "{}: cycle: does not increase at row {} ({} s); rows of two recordings were mixed":
    "$1: cycle: nimmt in Zeile $2 ($3 s) nicht zu; Zeilen zweier Aufzeichnungen sind vermischt",
  "{}: {}: infinite at row {} ({} s); a channel error of the device: cut it out or mark it missing":
    "$1: $2: unendlich in Zeile $3 ($4 s); ein Kanalfehler des Geräts: herausschneiden oder als fehlend kennzeichnen",
  "{}: {}: {} rows are NaN without being marked missing, the first run is rows {} to {} ({} to {} s); add a column '{}.quality' ({} = missing), or cut the rows out":
    "$1: $2: $3 Zeilen sind NaN, ohne als fehlend gekennzeichnet zu sein, zuerst die Zeilen $4 bis $5 ($6 bis $7 s); eine Spalte „$8.quality“ ($9 = fehlend) einfügen oder die Zeilen herausschneiden",
  "{}: is too short: {} rows are {} s, at least {} s are needed; record longer":
    "$1 ist zu kurz: $2 Zeilen sind $3 s, mindestens $4 s werden gebraucht; länger aufzeichnen",
  "{}: {}: too little was measured: all joints together in {} s, at least {} s are needed; look after this device and record again":
    "$1: $2: zu wenig gemessen: alle Gelenke zusammen in $3 s, mindestens $4 s werden gebraucht; dieses Gerät prüfen und neu aufzeichnen",
  "{}: {}: constant ({} {}) over the whole recording; check the sensor and its wiring, or move this joint":
    "$1: $2: konstant ($3 $4) über die ganze Aufzeichnung; den Aufnehmer und seine Verdrahtung prüfen oder dieses Gelenk bewegen",
  "{}: {}: reaches {} to {} m with a stroke of {} m; check the channel's unit, and whether the recording is of this machine":
    "$1: $2: reicht von $3 bis $4 m bei einem Hub von $5 m; die Einheit des Kanals prüfen, und ob die Aufzeichnung von dieser Maschine ist",
  "{}: {}: is {} mm from where {} and the linkage put it; check whether the recording is of this machine, then the linkage and the channel's unit":
    "$1: $2: liegt $3 mm neben dem, was $4 und die Koppelkinematik ergeben; prüfen, ob die Aufzeichnung von dieser Maschine ist, dann die Koppelkinematik und die Einheit des Kanals",
  "if time counts milliseconds call the column 'time [ms]'":
    "wenn time Millisekunden zählt, die Spalte „time [ms]“ nennen",
  "give --resample to bring it to that rate, or correct rate_hz":
    "mit --resample auf diese Rate bringen oder rate_hz berichtigen",
  "{}: resampled from {} Hz{} to {} Hz": "$1: von $2 Hz$3 auf $4 Hz umgetastet",
  "{}: {}: saturated: at the end of {} in rows {} to {} ({} to {} s); use a sensor of wider range or a gentler motion":
    "$1: $2: gesättigt: am Ende $3 in den Zeilen $4 bis $5 ($6 bis $7 s); einen Aufnehmer mit größerem Bereich oder eine sanftere Bewegung nehmen",
  "{}: is a motion file, not a recording; give what was recorded while it moved":
    "$1 ist eine Bewegungsdatei, keine Aufzeichnung; angeben, was bei der Bewegung aufgezeichnet wurde",
  "{}: line 1: columns are separated by {}, both fit; export with tabs":
    "$1: Zeile 1: Die Spalten sind durch $2 getrennt, beides passt; mit Tabulatoren exportieren",
  "{}: '{}' has signs between thousands; export numbers without them":
    "$1: „$2“ hat Tausendertrennzeichen; Zahlen ohne sie exportieren",
  "{}: some numbers have a decimal point and some a decimal comma; export all with points":
    "$1: Manche Zahlen haben einen Dezimalpunkt, manche ein Dezimalkomma; alle mit Punkt exportieren",
  "{}: '{}' may be a decimal comma or thousands, and no number in the file tells; export with decimal points":
    "$1: „$2“ kann ein Dezimalkomma oder ein Tausendertrennzeichen haben, und keine Zahl der Datei verrät es; mit Dezimalpunkt exportieren",
  "{}: column {} of the header has no name; name it, or remove the column":
    "$1: Spalte $2 der Kopfzeile hat keinen Namen; benennen oder entfernen",
  "{}: column '{}' is there {} times; names must differ":
    "$1: Spalte „$2“ gibt es $3-mal; Namen müssen verschieden sein",
  "{}: is a directory; give one recording (.parquet or .csv)":
    "$1 ist ein Verzeichnis; eine Aufzeichnung (.parquet oder .csv) angeben",
  "{}: is empty; record it again": "$1 ist leer; neu aufzeichnen",
  "{}: is the journal of an unfinished recording; seal it with 'hilfit recover'":
    "$1 ist das Journal einer unfertigen Aufzeichnung; mit „hilfit recover“ abschließen",
  "{}: {}: holds {}, not numbers; remove the column or export numbers":
    "$1: $2: enthält $3 statt Zahlen; die Spalte entfernen oder Zahlen exportieren",
  "{}: unknown kind of file '{}'; use .parquet or .csv": "$1: unbekannte Dateiart „$2“; .parquet oder .csv nehmen",
  "{}: no such file; give the path of a recording (.parquet or .csv)":
    "$1: diese Datei gibt es nicht; den Pfad einer Aufzeichnung (.parquet oder .csv) angeben",
  "{}: cannot be read ({})": "$1 ist nicht lesbar ($2)",
  "{}: is not a Parquet file although its name says so; export it again":
    "$1 ist trotz des Namens keine Parquet-Datei; noch einmal exportieren",
  "{}: is a Parquet file that is cut short or damaged; copy it again from where it was recorded":
    "$1 ist eine abgeschnittene oder beschädigte Parquet-Datei; noch einmal vom Ort der Aufzeichnung kopieren",
  "{}: cannot be written ({})": "$1 lässt sich nicht schreiben ($2)",
  "{}: is none of MDF4, MAT and a ROS 2 bag; give one of them":
    "$1 ist weder MDF4 noch MAT noch ein ROS-2-Bag; eines davon angeben",
  "{}: holds more than {} values; export the channels as Parquet":
    "$1 hat mehr als $2 Werte; die Kanäle als Parquet exportieren",
  "{}: {}: is no channel of numbers; export the measured values":
    "$1: $2 ist kein Kanal mit Zahlen; die gemessenen Werte exportieren",
  "{}: vectors differ in length: {}; save them on one time base":
    "$1: Vektoren verschiedener Länge: $2; auf einer Zeitbasis speichern",
  "{}: holds more than {} values; save the channels as Parquet or CSV":
    "$1 hat mehr als $2 Werte; die Kanäle als Parquet oder CSV speichern",
  "{}: is a MAT file of version 7.3; save it in MATLAB with save(..., '-v7'), or export CSV":
    "$1 ist eine MAT-Datei der Version 7.3; in MATLAB mit save(..., '-v7') speichern oder CSV exportieren",
  "{}: {}: is there {} times; export one of them, or rename the others":
    "$1: $2 gibt es $3-mal; einen davon exportieren oder die anderen umbenennen",
  "{}: holds too many messages; cut the bag, or export CSV":
    "$1 hat zu viele Nachrichten; den Bag kürzen oder CSV exportieren",
  "{}: {}: stands on other times than {}; export all channels on one raster, or give --resample":
    "$1: $2 steht zu anderen Zeiten als $3; alle Kanäle auf einem Raster exportieren oder --resample angeben",
  "{}: has no channel of '{}'; name the channels as the machine file does, or give --map":
    "$1 hat keinen Kanal von „$2“; die Kanäle wie in der Maschinendatei nennen oder --map angeben",
  "{}: its channels were not recorded at the same time; export a common stretch":
    "$1: Die Kanäle wurden nicht zur selben Zeit aufgezeichnet; einen gemeinsamen Abschnitt exportieren",
  "{}: has a header but no rows; export it again": "$1 hat eine Kopfzeile, aber keine Zeilen; noch einmal exportieren",
  "{}: metadata 'hilfit.units' is damaged; record or export it again":
    "$1: Die Metadaten „hilfit.units“ sind beschädigt; neu aufzeichnen oder exportieren",
  "{}: time: has {} rows, too few to resample; record longer":
    "$1: time: hat $2 Zeilen, zu wenige zum Umtasten; länger aufzeichnen",
  "{}: {}: {}; correct the file's metadata 'hilfit.units'":
    "$1: $2: $3; die Metadaten „hilfit.units“ der Datei berichtigen",
  "{}: {}: is there on two time bases; say which column with --map":
    "$1: $2 gibt es auf zwei Zeitbasen; mit --map sagen, welche Spalte",
  "{}: has a header but no rows; record at least {} s":
    "$1 hat eine Kopfzeile, aber keine Zeilen; mindestens $2 s aufzeichnen",
  "{}: {}.quality: holds something that is no quality; export it again":
    "$1: $2.quality enthält, was keine Qualität ist; noch einmal exportieren",
  "{}: {}: has rows without a number; export it again": "$1: $2 hat Zeilen ohne Zahl; noch einmal exportieren",
  "{}: {}: no values given for this channel": "$1: $2: für diesen Kanal gibt es keine Werte",
  "{}: {}: has shape {}, time has {}": "$1: $2 hat die Form $3, time hat $4",
  "{}: {}: machine '{}' has no such channel": "$1: Die Maschine „$3“ hat keinen Kanal $2",
};

/** Of machine files and what they name, and of buses that cannot be opened. */
const MACHINES: Record<string, string> = {
  "{}: is not a text file; give a machine file (YAML)": "$1 ist keine Textdatei; eine Maschinendatei (YAML) angeben",
  "{}: not a machine file; it must start with 'schema: {}'":
    "$1 ist keine Maschinendatei; sie muss mit „schema: $2“ beginnen",
  "{}: schema is {}; this version reads '{}'": "$1: schema ist $2; diese Version liest „$3“",
  "{}: no such file; give the path of a machine file (YAML)":
    "$1: diese Datei gibt es nicht; den Pfad einer Maschinendatei (YAML) angeben",
  "{}: is a directory; give the machine file itself (YAML)":
    "$1 ist ein Verzeichnis; die Maschinendatei selbst (YAML) angeben",
  "{}: cannot be read ({}); give a machine file (YAML)": "$1 ist nicht lesbar ($2); eine Maschinendatei (YAML) angeben",
  "{}: not valid YAML: {}; docs/machine-file.md shows a whole file":
    "$1: kein gültiges YAML: $2; docs/machine-file.md zeigt eine ganze Datei",
  "{}: buses: there are none, so nothing can be acquired; add buses and sources":
    "$1: buses: es gibt keine, also ist nichts zu erfassen; buses und sources ergänzen",
  "{}: channels: {} has no source; say which bus and device it comes from":
    "$1: channels: $2 hat keine source; sagen, von welchem Bus und Gerät er kommt",
  "{}: unknown kind of file; give {}": "$1: unbekannte Dateiart; $2 angeben",
  "{}: no such file; a path begins at the machine file's folder":
    "$1: diese Datei gibt es nicht; ein Pfad beginnt am Ordner der Maschinendatei",
  "{}: is larger than {} MB; is it the right file?": "$1 hat mehr als $2 MB; ist es die richtige Datei?",
  "{}: {}: names a file outside the machine's own folder; write its name alone, and have it put beside the machine file in the service's data directory":
    "$1: $2: nennt eine Datei außerhalb des Ordners der Maschine; nur ihren Namen schreiben und sie im Datenverzeichnis des Dienstes neben die Maschinendatei legen lassen",
  "{}: describes no CAN messages; give {}": "$1 beschreibt keine CAN-Botschaften; $2 angeben",
  "bus '{}': needs {}; run: pip install 'hilfit[dbc]'": "Bus „$1“ braucht $2; ausführen: pip install 'hilfit[dbc]'",
  "{}: is no {} file; export it again": "$1 ist keine $2-Datei; noch einmal exportieren",
  "acquisition of '{}' is not running after {} s; check its buses":
    "Die Erfassung von „$1“ läuft nach $2 s nicht; ihre Busse prüfen",
  "machine '{}' has no channel '{}'{}": "Die Maschine „$1“ hat keinen Kanal „$2“$3",
  "acquisition was not started; call start()": "Die Erfassung wurde nicht gestartet; start() aufrufen",
  "bus '{}': no driver for type '{}' is installed; there are {}":
    "Bus „$1“: Für die Art „$2“ ist kein Treiber installiert; es gibt $3",
  "bus '{}': {} {} cannot be opened ({}); check interface, channel and options in the machine file, and that the interface is up":
    "Bus „$1“: $2 $3 lässt sich nicht öffnen ($4); interface, channel und options der Maschinendatei prüfen, und ob die Schnittstelle eingeschaltet ist",
  "bus '{}': nothing answers at {}:{} ({}); start the socketcand server or correct host and port":
    "Bus „$1“: Bei $2:$3 antwortet nichts ($4); den socketcand-Server starten oder host und port berichtigen",
  "{} cannot be opened; check address and cable, and that the device is on":
    "$1 lässt sich nicht öffnen; Adresse und Kabel prüfen, und ob das Gerät eingeschaltet ist",
  "since and until have to be moments of UTC; write 2026-06-01T02:00:00Z":
    "since und until müssen Zeitpunkte in UTC sein; 2026-06-01T02:00:00Z schreiben",
  "{} has no time zone; write 2026-06-01T02:00:00Z": "$1 hat keine Zeitzone; 2026-06-01T02:00:00Z schreiben",
  "{}: says that it unpacks to {} MiB, {} times its size; export it again, in parts":
    "$1: entpackt sich nach eigener Angabe zu $2 MiB, dem $3-Fachen seiner Größe; in Teilen neu exportieren",
};

/** The sentence of a refusal. */
export const REFUSALS: Record<string, string> = { ...SERVICE, ...RECORDINGS, ...MACHINES, ...FITTING };
