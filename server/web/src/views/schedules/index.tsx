/** Schedules of the machine that is looked at. */
import { useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Button, Notice } from "../../ui/controls";
import { Empty, Panel } from "../../ui/layout";
import { ScheduleCard } from "./card";
import { ScheduleForm } from "./form";
import "./schedules.css";
import { t } from "../../texts";

type List = components["schemas"]["ScheduleList"];

export default function SchedulesView() {
  const machine = useSession().machine.value;
  if (machine === null)
    return (
      <>
        <h1 class="title">{t("common.schedules")}</h1>
        <Empty>{t("common.thereNoMachineYet2")}</Empty>
      </>
    );
  return <Schedules key={machine} machine={machine} />;
}

/** "new", the id of what is changed, or nothing. */
type Edited = string | null;

function Schedules({ machine }: { machine: string }) {
  const session = useSession();
  const [edited, setEdited] = useState<Edited>(null);
  const path = `/schedules?machine=${encodeURIComponent(machine)}&limit=200`;
  const list = useResource<List>(path, ["schedules", "jobs"]);
  const items = list.value?.items ?? [];
  const changed = items.find((one) => one.id === edited) ?? null;
  const end = (): void => {
    setEdited(null);
    list.reload();
  };
  if (edited === "new" || changed !== null)
    return (
      <>
        <h1 class="title">
          {t("common.schedules")} <span class="hint">{machine}</span>
        </h1>
        <ScheduleForm key={edited} machine={machine} schedule={changed} onEnd={end} />
      </>
    );
  return (
    <div class={list.stale ? "stale" : ""}>
      <h1 class="title">
        {t("common.schedules")} <span class="hint">{machine}</span>
      </h1>
      {list.error !== null && <Notice kind="bad">{list.error}</Notice>}
      {list.value === null && list.loading && <p role="status">{t("common.reading")}</p>}
      {list.value !== null && items.length === 0 && (
        <Panel title={t("common.scheduledRecalibration")}>
          <Empty>{t("schedules.nothingScheduledScheduleRecords")}</Empty>
        </Panel>
      )}
      {items.map((one) => (
        <ScheduleCard key={one.id} schedule={one} onEdit={() => setEdited(one.id)} onDone={list.reload} />
      ))}
      {session.may("engineer") ? (
        <Button kind="primary" onClick={() => setEdited("new")}>
          {t("schedules.newSchedule")}
        </Button>
      ) : (
        <p class="hint">{t("schedules.engineerMakesChangesSchedules")}</p>
      )}
    </div>
  );
}
