/** German for all that the service says. */
import { FINDINGS } from "./findings_de";
import { MACHINE_FILE } from "./machine_file_de";
import { REFUSALS, VALUES } from "./refusals_de";
import { REPORT } from "./report_de.gen";
import { compiled, translated } from "./sentences";
import { SERVICE_FIXED, SERVICE_SENTENCES } from "./service_de";
import { VALVE } from "./valve_de";

const open = compiled({ ...REPORT, ...MACHINE_FILE, ...FINDINGS, ...REFUSALS, ...VALVE });

export const german = translated(
  { ...VALUES, ...open.fixed, ...SERVICE_FIXED },
  [...SERVICE_SENTENCES, ...open.sentences],
  open.inner,
  open.joints,
);
