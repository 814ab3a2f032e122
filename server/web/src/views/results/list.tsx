/** All identifications of the machine that is looked at, newest first. */
import type { components } from "../../net/api.gen";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Mark, Notice } from "../../ui/controls";
import { change, time } from "../../ui/format";
import { Empty, Panel, Table } from "../../ui/layout";
import { jobWords } from "../../words";
import { verdictWords } from "./wording";
import { t } from "../../texts";

type List = components["schemas"]["IdentificationList"];
type Jobs = components["schemas"]["JobList"];

export function ResultList() {
  const session = useSession();
  const machine = session.machine.value;
  const path = machine === null ? null : `/identifications?machine=${encodeURIComponent(machine)}&limit=100`;
  const list = useResource<List>(path, ["identifications", "jobs"]);
  const jobs = useResource<Jobs>("/jobs?limit=500", "jobs");
  const states = new Map((jobs.value?.items ?? []).map((job) => [job.id, job]));
  const items = list.value?.items ?? [];
  return (
    <div class={list.stale ? "stale" : ""}>
      <h1 class="title">
        {t("common.results")} {machine !== null && <span class="hint">{machine}</span>}
      </h1>
      {list.error !== null && <Notice kind="bad">{list.error}</Notice>}
      {list.value === null && list.loading && <p role="status">{t("common.reading")}</p>}
      {list.value !== null && (
        <Panel title={t("common.newestFirst")}>
          {items.length === 0 ? (
            <Empty>{t("results.nothingWasIdentifiedMachine")}</Empty>
          ) : (
            <Table
              caption={t("results.identificationsNewestFirst")}
              columns={[
                { name: "label", title: t("results.result") },
                { name: "verdict", title: t("results.verdict") },
                { name: "change", title: t("results.errorAllJoints2"), align: "right" },
                { name: "created", title: t("common.submitted") },
              ]}
              rows={items.map((one) => {
                const state = states.get(one.job)?.state;
                const [kind, words] = one.verdict !== null ? verdictWords(one.verdict) : jobWords(state ?? "queued");
                return {
                  key: one.id,
                  label: (
                    <a class="row-link" href={`#/results/${one.id}`}>
                      {one.label || one.id}
                    </a>
                  ),
                  verdict: <Mark kind={kind}>{words}</Mark>,
                  change: <span class="number-cell">{change(changeOf(one.overall))}</span>,
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

function changeOf(overall: Record<string, unknown> | null): number | null {
  const value = overall?.change_percent;
  return typeof value === "number" ? value : null;
}
