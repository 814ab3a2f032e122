/** One result, from the verdict down to the recordings. */
import { useEffect, useMemo } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Notice } from "../../ui/controls";
import { Panel } from "../../ui/layout";
import { JobPanel } from "../jobs";
import { ResultActions } from "./actions";
import { Verdict } from "./answers_panel";
import { Diagnostics } from "./diagnostics";
import { Frictions, Residuals } from "./drawings";
import { Candidates, Found, Limits, Moved } from "./findings";
import { JointErrors } from "./joint_errors";
import { NextExperiment } from "./next_experiment";
import { DataUsed, Parameters } from "./parameters";
import { type Report, readReport } from "./report";
import { readable } from "./wording";
import { t } from "../../texts";
import { table } from "../../texts/report";

type Identification = components["schemas"]["IdentificationResource"];
type Job = components["schemas"]["JobResource"];

export function ResultPage({ id }: { id: string }) {
  const session = useSession();
  const place = `/identifications/${encodeURIComponent(id)}`;
  const identification = useResource<Identification>(place, ["identifications", "jobs"]);
  const found = identification.value;
  // Who comes by a link goes on to the guide or the calibrations of the machine that is shown.
  useEffect(() => {
    if (found !== null) session.choose(found.machine);
  }, [found?.machine]);
  const done = found !== null && found.verdict !== null;
  const job = useResource<Job>(found === null || done ? null : `/jobs/${encodeURIComponent(found.job)}`, "jobs");
  const content = useResource<unknown>(done ? `${place}/report.json` : null, []);
  const report = useMemo(() => readReport(content.value), [content.value, table.value]);
  return (
    <div class={identification.stale ? "stale" : ""}>
      <h1 class="title">
        {found?.label || t("results.result")} {found !== null && <span class="hint">{found.machine}</span>}
      </h1>
      {identification.error !== null && <Notice kind="bad">{identification.error}</Notice>}
      {content.error !== null && <Notice kind="bad">{content.error}</Notice>}
      {(identification.loading || content.loading) && report === null && <p role="status">{t("common.reading")}</p>}
      {job.value !== null && <JobPanel job={job.value} />}
      {content.value !== null && report === null && <Notice kind="warning">{t("results.pageCannotReadReport")}</Notice>}
      {report !== null && <Verdict report={report} />}
      {report !== null && report.warnings.length > 0 && <Warnings report={report} />}
      {found !== null && done && <ResultActions identification={found} />}
      {report !== null && <Sections id={id} report={report} />}
      <p>
        <a href="#/results">{t("results.allResults")}</a>
      </p>
    </div>
  );
}

function Sections({ id, report }: { id: string; report: Report }) {
  return (
    <>
      <NextExperiment id={id} report={report} />
      <JointErrors report={report} />
      <Found report={report} />
      <Residuals report={report} />
      <Diagnostics report={report} />
      <Candidates report={report} />
      <Moved report={report} />
      <Limits report={report} />
      <Frictions report={report} />
      <Parameters report={report} />
      <DataUsed report={report} />
    </>
  );
}

function Warnings({ report }: { report: Report }) {
  return (
    <Panel title={t("results.warnings", { count: report.warnings.length })}>
      <ul class="plain-list">
        {report.warnings.map((warning) => (
          <li key={warning}>{readable(warning, report)}</li>
        ))}
      </ul>
    </Panel>
  );
}
