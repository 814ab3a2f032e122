/** All identifications of the valves of the machine that is looked at, newest first; and how one is ordered. */
import type { components } from "../../net/api.gen";
import { Panel } from "../../ui/layout";
import { DASH, share } from "../../ui/format";
import { t } from "../../texts";
import { FitList } from "../fits";
import { jobWords } from "../../words";

type Valve = components["schemas"]["ValveResource"];

export function ValveList() {
  return (
    <FitList<Valve>
      kind="valves"
      view="valves"
      title={t("shell.valves")}
      caption={t("valves.identifications")}
      none={t("valves.noneYet")}
      outcome={{ title: t("common.state") }}
      error={{ title: t("valves.errorOfSpeed") }}
      ended={(one) => (one.axes === null ? null : jobWords("done"))}
      cell={errors}
    >
      <Panel title={t("valves.how")}>
        <p class="hint">{t("valves.whatIsIdentified")}</p>
        <div class="actions">
          <a class="button primary" href="#/recordings">
            {t("valves.chooseRecordings")}
          </a>
        </div>
        <p class="hint">{t("valves.whatToRecord")}</p>
      </Panel>
    </FitList>
  );
}

function errors(one: Valve): string {
  if (one.axes === null) return DASH;
  return Object.entries(one.axes)
    .map(([joint, axis]) => `${joint} ${share(axis.error)}`)
    .join(", ");
}
