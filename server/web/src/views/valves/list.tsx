/** All identifications of the valves of the machine that is looked at, newest first; and how one is ordered. */
import type { components } from "../../net/api.gen";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Mark, Notice } from "../../ui/controls";
import { DASH, share, time } from "../../ui/format";
import { Empty, Panel, Table } from "../../ui/layout";
import { jobWords } from "../../words";
import { t } from "../../texts";

type List = components["schemas"]["ValveList"];
type Valve = components["schemas"]["ValveResource"];
type Jobs = components["schemas"]["JobList"];

export function ValveList() {
  const session = useSession();
  const machine = session.machine.value;
  const path = machine === null ? null : `/valves?machine=${encodeURIComponent(machine)}&limit=100`;
  const list = useResource<List>(path, ["valves", "jobs"]);
  const jobs = useResource<Jobs>("/jobs?limit=500", "jobs");
  const states = new Map((jobs.value?.items ?? []).map((job) => [job.id, job]));
  const items = list.value?.items ?? [];
  return (
    <div class={list.stale ? "stale" : ""}>
      <h1 class="title">
        {t("shell.valves")} {machine !== null && <span class="hint">{machine}</span>}
      </h1>
      {list.error !== null && <Notice kind="bad">{list.error}</Notice>}
      <Panel title={t("valves.how")}>
        <p class="hint">{t("valves.whatIsIdentified")}</p>
        <div class="actions">
          <a class="button primary" href="#/recordings">
            {t("valves.chooseRecordings")}
          </a>
        </div>
        <p class="hint">{t("valves.whatToRecord")}</p>
      </Panel>
      {list.value === null && list.loading && <p role="status">{t("common.reading")}</p>}
      {list.value !== null && (
        <Panel title={t("common.newestFirst")}>
          {items.length === 0 ? (
            <Empty>{t("valves.noneYet")}</Empty>
          ) : (
            <Table
              caption={t("valves.identifications")}
              columns={[
                { name: "label", title: t("results.result") },
                { name: "state", title: t("common.state") },
                { name: "error", title: t("valves.errorOfSpeed") },
                { name: "created", title: t("common.submitted") },
              ]}
              rows={items.map((one) => {
                const [kind, words] = jobWords(states.get(one.job)?.state ?? (one.axes === null ? "queued" : "done"));
                return {
                  key: one.id,
                  label: (
                    <a class="row-link" href={`#/valves/${one.id}`}>
                      {one.label || one.id}
                    </a>
                  ),
                  state: <Mark kind={kind}>{words}</Mark>,
                  error: errors(one),
                  created: time(one.created),
                };
              })}
            />
          )}
        </Panel>
      )}
    </div>
  );
}

function errors(one: Valve): string {
  if (one.axes === null) return DASH;
  return Object.entries(one.axes)
    .map(([joint, axis]) => `${joint} ${share(axis.error)}`)
    .join(", ");
}
