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

type Job = components["schemas"]["JobResource"];
type List = components["schemas"]["JobList"];

const KINDS: Record<string, string> = {
  identification: "Identification",
  excitation: "Design of a motion",
  recalibration: "Scheduled recalibration",
};
const STAGES: Record<string, string> = {
  check: "Check recordings and equations",
  cylinder_stage: "Friction and stiffness of each drive",
  rigid_body_stage: "Masses and inertias, friction kept",
  residual: "Noise floor",
  attribution: "What causes the remaining error",
  refit: "Fit all jointly once more",
  report: "Write the report",
  design: "Design the motion",
  record: "Record",
  identify: "Fit the new recordings",
  compare: "Compare with the active calibration",
  propose: "Propose the new calibration",
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
      <h1 class="title">Jobs</h1>
      {jobs.error !== null && <Notice kind="bad">{jobs.error}</Notice>}
      <Panel title="Newest first">
        {jobs.value !== null && items.length === 0 ? (
          <Empty>Nothing was ordered yet.</Empty>
        ) : (
          <Table
            caption="Jobs"
            columns={[
              { name: "label", title: "What" },
              { name: "state", title: "State" },
              { name: "progress", title: "Progress" },
              { name: "created", title: "Submitted" },
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
                (job.error ?? job.text)
              ) : (
                <>
                  <Progress fraction={job.fraction} text={job.text} />
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
      <h1 class="title">{job.value?.label ?? "Job"}</h1>
      {job.error !== null && <Notice kind="bad">{job.error}</Notice>}
      {job.value !== null && <JobPanel job={job.value} />}
      <p>
        <a href="#/jobs">All jobs</a>
      </p>
    </div>
  );
}

/** How long a job will probably still take, and what is known where that is not. */
export function remaining(job: Job, now: number): string {
  if (job.state === "queued") return "Begins when the jobs before it are over.";
  if (job.expected_end === null || job.expected_end === undefined) return "How long it will take is not known yet.";
  const seconds = (new Date(job.expected_end).getTime() - now) / 1000;
  return seconds < 1 ? "It takes longer than usual." : `About ${duration(rounded(seconds))} left.`;
}

/** No more exact than an estimate is. */
function rounded(seconds: number): number {
  const step = seconds < 60 ? 5 : seconds < 600 ? 10 : seconds < 3600 ? 60 : 300;
  return Math.max(step, Math.round(seconds / step) * step);
}

function Remaining({ job }: { job: Job }) {
  return <p class="hint remaining">{remaining(job, useSecond())}</p>;
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
      {!over(job) && <Progress fraction={job.fraction} text={job.text} />}
      {!over(job) && <Remaining job={job} />}
      {job.state === "failed" && <Notice kind="bad">{job.error ?? job.text}</Notice>}
      {job.state === "cancelled" && <Notice kind="info">It was cancelled; nothing was stored.</Notice>}
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
                    ? "done"
                    : state === "now"
                      ? "running"
                      : state === "broke"
                        ? "broke off"
                        : "not begun"}
                </span>
              </Mark>
            </li>
          );
        })}
      </ol>
      <p class="hint">
        Submitted {time(job.created)}, {job.ended === null ? "not ended" : `ended ${time(job.ended)}`}
        {took === null ? "" : `, took ${took}`}
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
            {job.cancel_requested ? "Is being cancelled …" : "Cancel"}
          </Button>
        )}
      </div>
      {asking && (
        <Confirm
          title="Cancel this job?"
          text={`“${job.label}” stops, and what it did so far is dropped.`}
          confirm="Cancel the job"
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
      ? [`#/results/${job.subject}`, "View the result"]
      : job.kind === "recalibration"
        ? ["#/calibrations", "View the calibrations"]
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
