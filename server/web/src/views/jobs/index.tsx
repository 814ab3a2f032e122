/** Long work: what runs, how far it is, how it ended. */
import { useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { useRoute } from "../../routes";
import { CommandNotice, useCommand } from "../../command";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Button, Mark, Notice, Progress } from "../../ui/controls";
import { useSecond } from "../../ui/clock";
import { DASH, duration, time } from "../../ui/format";
import { Confirm, Empty, Panel, Table } from "../../ui/layout";
import { jobWords } from "../../words";
import { t } from "../../texts";
import { said } from "../../texts/report";

type Job = components["schemas"]["JobResource"];
type List = components["schemas"]["JobList"];

const KINDS: Record<string, string> = {
  identification: t("jobs.identification"),
  valve: t("jobs.valves"),
  excitation: t("jobs.designMotion"),
  recalibration: t("common.scheduledRecalibration"),
};
const STAGES: Record<string, string> = {
  check: t("jobs.checkRecordingsEquations"),
  cylinder_stage: t("jobs.frictionStiffnessEachDrive"),
  rigid_body_stage: t("jobs.massesInertiasFrictionKept"),
  residual: t("jobs.noiseFloor"),
  attribution: t("jobs.whatCausesRemainingError"),
  refit: t("jobs.fitAllJointlyOnce"),
  report: t("jobs.writeTheReport"),
  valve: t("jobs.commandsToSpeeds"),
  design: t("jobs.designTheMotion"),
  record: t("jobs.record"),
  identify: t("jobs.fitNewRecordings"),
  compare: t("jobs.compareWithActiveCalibration"),
  propose: t("jobs.proposeNewCalibration"),
};

export default function JobsView() {
  const [, id] = useRoute().path;
  return id === undefined ? <JobsPage /> : <JobPage key={id} id={id} />;
}

function JobsPage() {
  const jobs = useResource<List>("/jobs?limit=100", "jobs");
  const items = jobs.value?.items ?? [];
  return (
    <div class={jobs.stale ? "stale" : ""}>
      <h1 class="title">{t("common.jobs")}</h1>
      {jobs.error !== null && <Notice kind="bad">{jobs.error}</Notice>}
      <Panel title={t("common.newestFirst")}>
        {jobs.value !== null && items.length === 0 ? (
          <Empty>{t("jobs.nothingWasOrderedYet")}</Empty>
        ) : (
          <Table
            caption={t("common.jobs")}
            columns={[
              { name: "label", title: t("jobs.what") },
              { name: "state", title: t("common.state") },
              { name: "progress", title: t("jobs.progress") },
              { name: "created", title: t("common.submitted") },
            ]}
            rows={items.map((job) => ({
              key: job.id,
              label: (
                <a class="row-link" href={`#/jobs/${job.id}`}>
                  {job.label}
                </a>
              ),
              state: <Mark kind={jobWords(job.state)[0]}>{jobWords(job.state)[1]}</Mark>,
              progress: over(job) ? (
                saidOfEnd(job)
              ) : (
                <>
                  <Progress fraction={job.fraction} text={said(job.text, job.text_message)} />
                  <Remaining job={job} />
                </>
              ),
              created: time(job.created),
            }))}
          />
        )}
      </Panel>
    </div>
  );
}

function JobPage({ id }: { id: string }) {
  const job = useResource<Job>(`/jobs/${encodeURIComponent(id)}`, "jobs");
  return (
    <div class={job.stale ? "stale" : ""}>
      <h1 class="title">{job.value?.label ?? t("common.job")}</h1>
      {job.error !== null && <Notice kind="bad">{job.error}</Notice>}
      {job.value !== null && <JobPanel job={job.value} />}
      <p>
        <a href="#/jobs">{t("jobs.allJobs")}</a>
      </p>
    </div>
  );
}

/** How long a job will probably still take, and what is known where that is not. */
export function remaining(job: Job, now: number): string {
  if (job.state === "queued") return t("jobs.beginsWhenJobsBefore");
  if (job.expected_end === null || job.expected_end === undefined) return t("jobs.howLongWillTake");
  const seconds = (new Date(job.expected_end).getTime() - now) / 1000;
  return seconds < 1 ? t("jobs.takesLongerThanUsual") : t("jobs.aboutLeft", { seconds: duration(rounded(seconds)) });
}

/** No more exact than an estimate is. */
function rounded(seconds: number): number {
  const step = seconds < 60 ? 5 : seconds < 600 ? 10 : seconds < 3600 ? 60 : 300;
  return Math.max(step, Math.round(seconds / step) * step);
}

function Remaining({ job }: { job: Job }) {
  return <p class="hint remaining">{remaining(job, useSecond())}</p>;
}

/** Why a job failed, or how it ended. */
function saidOfEnd(job: Job): string {
  return job.error === null ? said(job.text, job.text_message) : said(job.error, job.error_message);
}

export function over(job: Job): boolean {
  return job.state === "done" || job.state === "failed" || job.state === "cancelled";
}

/** A job with its steps, how far it is, and the way to its result. */
export function JobPanel({ job }: { job: Job }) {
  const session = useSession();
  const command = useCommand();
  const [asking, setAsking] = useState(false);
  const [kind, words] = jobWords(job.state);
  const took = seconds(job.started, job.ended);
  return (
    <Panel title={KINDS[job.kind] ?? job.kind} actions={<Mark kind={kind}>{words}</Mark>}>
      {!over(job) && <Progress fraction={job.fraction} text={said(job.text, job.text_message)} />}
      {!over(job) && <Remaining job={job} />}
      {job.state === "failed" && <Notice kind="bad">{saidOfEnd(job)}</Notice>}
      {job.state === "cancelled" && <Notice kind="info">{t("jobs.wasCancelledNothingWas")}</Notice>}
      <ol class="steps">
        {job.stages.map((stage, index) => {
          const state = stageState(job, index);
          return (
            <li key={stage} class={state}>
              <Mark kind={state === "done" ? "good" : state === "now" ? "info" : state === "broke" ? "bad" : "off"}>
                {STAGES[stage] ?? stage}
                <span class="for-reader">
                  :{" "}
                  {state === "done"
                    ? t("jobs.done")
                    : state === "now"
                      ? t("jobs.running")
                      : state === "broke"
                        ? t("jobs.brokeOff")
                        : t("jobs.notBegun")}
                </span>
              </Mark>
            </li>
          );
        })}
      </ol>
      <p class="hint">
        {t("jobs.submitted", {
          created: time(job.created),
          ended: job.ended === null ? t("jobs.notEnded") : t("jobs.ended", { ended: time(job.ended) }),
          took: took === null ? "" : t("jobs.took", { took }),
        })}
      </p>
      <CommandNotice of={command} />
      <div class="actions">
        {job.state === "done" && <ResultLink job={job} />}
        {!over(job) && session.may("operate") && (
          <Button
            busy={command.busy}
            disabled={job.cancel_requested || !session.online.value}
            onClick={() => setAsking(true)}
          >
            {job.cancel_requested ? t("jobs.isBeingCancelled") : t("jobs.cancel")}
          </Button>
        )}
      </div>
      {asking && (
        <Confirm
          title={t("jobs.cancelThisJob")}
          text={t("jobs.stopsWhatDidSo", { label: job.label })}
          confirm={t("jobs.cancelTheJob")}
          kind="danger"
          onNo={() => setAsking(false)}
          onYes={() => {
            setAsking(false);
            void command.run({ method: "POST", path: `/jobs/${job.id}/cancel` });
          }}
        />
      )}
    </Panel>
  );
}

function ResultLink({ job }: { job: Job }) {
  const [href, words] =
    job.kind === "identification"
      ? [`#/results/${job.subject}`, t("common.viewTheResult")]
      : job.kind === "valve"
        ? [`#/valves/${job.subject}`, t("common.viewTheResult")]
        : job.kind === "recalibration"
          ? ["#/calibrations", t("jobs.viewTheCalibrations")]
          : [null, DASH];
  return href === null ? null : (
    <a class="button primary" href={href}>
      {words}
    </a>
  );
}

function stageState(job: Job, index: number): "done" | "now" | "broke" | "later" {
  if (job.state === "done") return "done";
  const at = job.stage === null ? -1 : job.stages.indexOf(job.stage);
  if (index < at) return "done";
  if (index > at || job.state === "queued") return "later";
  return over(job) ? "broke" : "now";
}

function seconds(from: string | null, to: string | null): string | null {
  if (from === null || to === null) return null;
  return duration((new Date(to).getTime() - new Date(from).getTime()) / 1000);
}
