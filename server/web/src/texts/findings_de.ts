/**
 * German for findings of the bus check; as `refusals_de.ts`. Those of `hilfit check` stand in reports as well, and are
 * in `report_de.gen.ts`.
 */

export const FINDINGS: Record<string, string> = {
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
