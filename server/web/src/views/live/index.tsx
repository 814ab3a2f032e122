/** What the machine does now. */
import { useEffect, useMemo } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { later } from "../../later";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Mark, Notice } from "../../ui/controls";
import { duration } from "../../ui/format";
import { Empty, Panel } from "../../ui/layout";
import { acquisitionWords } from "../../words";
import { FaultPanel } from "./fault_panel";
import { groups, type MachineContent } from "./groups";
import { MonitorPanel } from "./monitor_panel";
import { RecordPanel } from "./record_panel";
import { SILENT_S } from "./quality";
import { useLive } from "./use_live";
import { t } from "../../texts";
import type { Message } from "../../texts/message";
import { said } from "../../texts/report";

/** They bring what draws: it takes its time on a slow tablet, and comes once the page around them is there. */
const Plots = later(() => import("./plots"));
type Detail = components["schemas"]["MachineDetail"];

export default function LiveView() {
  const session = useSession();
  const machine = session.machine.value;
  if (machine === null)
    return (
      <>
        <h1>{t("live.live")}</h1>
        <Empty>
          {t("common.thereNoMachineYet")} <a href="#/machines">{t("live.uploadMachineFile")}</a>
        </Empty>
      </>
    );
  return <LiveMachine key={machine} machine={machine} />;
}

function LiveMachine({ machine }: { machine: string }) {
  const session = useSession();
  const detail = useResource<Detail>(`/machines/${encodeURIComponent(machine)}`, "machines");
  const live = useLive(machine);
  const content = detail.value?.machine as unknown as MachineContent | undefined;
  const shown = useMemo(() => (content === undefined ? [] : groups(content)), [content]);
  useEffect(() => void Plots.fetch().catch(() => undefined), []); // it says so itself when it is shown
  const state = live.history.acquisition ?? String(detail.value?.acquisition.state ?? "off");
  const known = live.history.acquisition !== null || detail.value !== null;
  const [kind, words] = known ? acquisitionWords(state) : (["info", t("live.askingWhatAcquisitionDoes")] as const);
  const silent = live.silence >= SILENT_S;
  const error = detail.value?.acquisition.error;
  return (
    <>
      <div class="title live-title">
        <h1>{t("live.live")}</h1>
        <Mark kind={silent && kind === "good" ? "warning" : kind}>{words}</Mark>
        <LinkMark link={live.link} silence={live.silence} answered={session.online.value && detail.error === null} />
      </div>
      {state !== "running" && typeof error === "string" && (
        <Notice kind="bad">{said(error, detail.value?.acquisition.error_message as Message | null)}</Notice>
      )}
      {detail.error !== null && detail.value === null && <Notice kind="bad">{detail.error}</Notice>}
      <div class="live-columns">
        <div class="first">
          <RecordPanel machine={machine} acquired={known ? state === "running" : null} />
        </div>
        <Panel title={t("live.signals")}>
          {live.history.readings.size === 0 || content === undefined ? (
            <Empty>
              {live.link === "live" && state !== "running"
                ? t("live.nothingMeasuredAcquisitionMachine")
                : t("common.connecting")}
            </Empty>
          ) : (
            <Plots machine={machine} groups={shown} live={live} />
          )}
        </Panel>
        <div>
          <MonitorPanel machine={machine} />
          <FaultPanel machine={machine} />
        </div>
      </div>
    </>
  );
}

/** Whether what is shown is live, and since when it is not; `answered`: the service answers other questions too. */
function LinkMark({ link, silence, answered }: { link: string; silence: number; answered: boolean }) {
  if (silence < SILENT_S)
    return answered ? (
      <Mark kind="good">{t("live.live")}</Mark>
    ) : (
      <Mark kind="warning">{t("live.valuesComeButService")}</Mark>
    );
  const since = Number.isFinite(silence) ? t("live.staleFor", { silence: duration(silence) }) : t("live.noValuesYet");
  return (
    <Mark kind={Number.isFinite(silence) ? "bad" : "info"}>
      {link === "live" ? since : t("live.connecting", { since })}
    </Mark>
  );
}
