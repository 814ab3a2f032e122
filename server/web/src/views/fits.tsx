/** All fits of one kind of the machine that is looked at, newest first. */
import type { ComponentChildren } from "preact";
import { useResource } from "../resource";
import { useSession } from "../session";
import type { components } from "../net/api.gen";
import { Mark, Notice, type NoticeKind } from "../ui/controls";
import { time } from "../ui/format";
import { type Column, Empty, Panel, Table } from "../ui/layout";
import { jobWords } from "../words";
import { t } from "../texts";

type Jobs = components["schemas"]["JobList"];

interface Fit {
  id: string;
  job: string;
  label: string;
  created: string;
}

interface Props<One extends Fit> {
  /** The resource, and the route of the page's view. */
  kind: "identifications" | "valves";
  view: string;
  title: string;
  caption: string;
  /** Said where there are none. */
  none: string;
  /** Columns of what came of one, and of its error. */
  outcome: Omit<Column, "name">;
  error: Omit<Column, "name">;
  /** What came of it, once that is known; until then its job's state is said. */
  ended: (one: One) => [NoticeKind | "off", string] | null;
  cell: (one: One) => ComponentChildren;
  /** Above the list. */
  children?: ComponentChildren;
}

export function FitList<One extends Fit>(props: Props<One>) {
  const { kind, view, title, caption, none, outcome, error, ended, cell, children } = props;
  const machine = useSession().machine.value;
  const path = machine === null ? null : `/${kind}?machine=${encodeURIComponent(machine)}&limit=100`;
  const list = useResource<{ items: One[] }>(path, [kind, "jobs"]);
  const jobs = useResource<Jobs>("/jobs?limit=500", "jobs");
  const states = new Map((jobs.value?.items ?? []).map((job) => [job.id, job.state]));
  const items = list.value?.items ?? [];
  return (
    <div class={list.stale ? "stale" : ""}>
      <h1 class="title">
        {title} {machine !== null && <span class="hint">{machine}</span>}
      </h1>
      {list.error !== null && <Notice kind="bad">{list.error}</Notice>}
      {children}
      {list.value === null && list.loading && <p role="status">{t("common.reading")}</p>}
      {list.value !== null && (
        <Panel title={t("common.newestFirst")}>
          {items.length === 0 ? (
            <Empty>{none}</Empty>
          ) : (
            <Table
              caption={caption}
              columns={[
                { name: "label", title: t("results.result") },
                { name: "outcome", ...outcome },
                { name: "error", ...error },
                { name: "created", title: t("common.submitted") },
              ]}
              rows={items.map((one) => {
                const [mark, words] = ended(one) ?? jobWords(states.get(one.job) ?? "queued");
                return {
                  key: one.id,
                  label: (
                    <a class="row-link" href={`#/${view}/${one.id}`}>
                      {one.label || one.id}
                    </a>
                  ),
                  outcome: <Mark kind={mark}>{words}</Mark>,
                  error: cell(one),
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
