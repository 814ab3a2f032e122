/** German for all that the service says. */
import { COMPOSED, FINDINGS } from "./findings_de";
import { MACHINE_FILE } from "./machine_file_de";
import { REFUSALS, VALUES } from "./refusals_de";
import { REPORT_FIXED, REPORT_SENTENCES } from "./report_de";
import { compiled, translated } from "./sentences";
import { SERVICE_FIXED, SERVICE_SENTENCES } from "./service_de";

const open = compiled({ ...COMPOSED, ...MACHINE_FILE, ...FINDINGS, ...REFUSALS });

export const german = translated(
  { ...VALUES, ...open.fixed, ...REPORT_FIXED, ...SERVICE_FIXED },
  [...SERVICE_SENTENCES, ...REPORT_SENTENCES, ...open.sentences],
  open.inner,
);
