/** One identification of valves: what to take to the controller first, then axis by axis. */
import { useEffect, useMemo } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Notice } from "../../ui/controls";
import { Panel } from "../../ui/layout";
import { Downloads } from "../downloads";
import { JobPanel } from "../jobs";
import { Proposal } from "../results/actions";
import { AxisPanel } from "./axis";
import { readValves } from "./report";
import { t } from "../../texts";
import { said, table } from "../../texts/report";

type Valve = components["schemas"]["ValveResource"];
type Job = components["schemas"]["JobResource"];

export function ValvePage({ id }: { id: string }) {
  const session = useSession();
  const place = `/valves/${encodeURIComponent(id)}`;
  const valve = useResource<Valve>(place, ["valves", "jobs"]);
  const found = valve.value;
  useEffect(() => {
    if (found !== null) session.choose(found.machine);
  }, [found?.machine]);
  const done = found !== null && found.axes !== null;
  const job = useResource<Job>(found === null || done ? null : `/jobs/${encodeURIComponent(found.job)}`, "jobs");
  const content = useResource<unknown>(done ? `${place}/valve.json` : null, []);
  const report = useMemo(() => readValves(content.value), [content.value, table.value]);
  const movable = done && Object.values(found.axes ?? {}).some((axis) => Object.keys(axis.speeds).length > 0);
  return (
    <div class={valve.stale ? "stale" : ""}>
      <h1 class="title">
        {found?.label || t("shell.valves")} {found !== null && <span class="hint">{found.machine}</span>}
      </h1>
      {valve.error !== null && <Notice kind="bad">{valve.error}</Notice>}
      {content.error !== null && <Notice kind="bad">{content.error}</Notice>}
      {(valve.loading || content.loading) && report === null && <p role="status">{t("common.reading")}</p>}
      {job.value !== null && <JobPanel job={job.value} />}
      {content.value !== null && report === null && <Notice kind="warning">{t("results.pageCannotReadReport")}</Notice>}
      {done && <ForTheController id={id} machine={found.machine} movable={movable} />}
      {done && (
        <Panel title={t("results.useThisResult")}>
          <p class="hint">{t("valves.watchedAgainst")}</p>
          <Proposal of="valves" source={found} />
        </Panel>
      )}
      {report !== null &&
        Object.entries(report.axes).map(([joint, axis]) => <AxisPanel key={joint} joint={joint} axis={axis} />)}
      {report !== null && report.warnings.length > 0 && (
        <Panel title={t("results.warnings", { count: report.warnings.length })}>
          <ul class="plain-list">
            {report.warnings.map((warning) => (
              <li key={warning}>{said(warning)}</li>
            ))}
          </ul>
        </Panel>
      )}
      <p>
        <a href="#/valves">{t("valves.all")}</a>
      </p>
    </div>
  );
}

/** Formats of the inverse, as people call them. */
const FORMATS: [string, string][] = [
  ["st", "Structured Text"],
  ["c", "C"],
  ["python", "Python"],
  ["csv", "CSV"],
  ["fmu", "FMU"],
];

function ForTheController({ id, machine, movable }: { id: string; machine: string; movable: boolean }) {
  const place = `/valves/${encodeURIComponent(id)}`;
  const name = `${machine}-${id}`;
  const inverses = FORMATS.map(([format, title]) => ({
    title,
    path: `${place}/inverse.zip?format=${format}`,
    name: `${name}-inverse-${format}.zip`,
  }));
  return (
    <Panel title={t("valves.forTheController")}>
      <p class="hint">{t("valves.inverseSays")}</p>
      <Downloads
        files={[
          ...(movable ? inverses : []),
          { title: t("results.reportAsDataJson"), path: `${place}/valve.json`, name: `${name}-valve.json` },
        ]}
      />
      <p class="hint">{t("valves.safety")}</p>
    </Panel>
  );
}
