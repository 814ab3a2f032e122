/** What to record next to tell apart what these recordings could not: a motion where one helps, else what else does. */
import { Panel } from "../../ui/layout";
import { Downloads } from "../downloads";
import type { NextExperiment as Experiment, Report } from "./report";
import { capital, readable, title } from "./wording";

export function NextExperiment({ id, report }: { id: string; report: Report }) {
  const next = report.loop.next_experiment;
  if (next === null || next === "") return null;
  const joint = typeof next === "string" ? null : (next.joint ?? null);
  const said = (text: string): string => capital(readable(text, report, joint));
  if (typeof next === "string")
    return (
      <Panel title="Next experiment">
        <p>{said(next)}</p>
      </Panel>
    );
  const motion = next.kind != null;
  // Where no motion helps, its text is the list of what else does.
  const otherwise = (next.otherwise ?? []).length > 0 ? (next.otherwise ?? []) : motion ? [] : [next.motion ?? ""];
  const other = (
    <ul class="plain-list">
      {otherwise.filter(Boolean).map((text) => (
        <li key={text}>{said(text)}</li>
      ))}
    </ul>
  );
  return (
    <Panel title="Next experiment">
      {motion ? (
        <p>
          <strong>{said(next.motion ?? "")}</strong>
        </p>
      ) : (
        <>
          <p>
            <strong>
              To tell {rivals(next, report)} apart, record once more and change what a motion alone cannot change:
            </strong>
          </p>
          {other}
        </>
      )}
      {next.why && <p>{said(next.why)}.</p>}
      {motion && <p class="hint">It tells apart: {rivals(next, report)}.</p>}
      {motion && otherwise.length > 0 && (
        <details>
          <summary>What else would tell them apart</summary>
          {other}
        </details>
      )}
      {next.motion_file && (
        <Downloads
          files={[
            {
              title: "this motion (CSV)",
              path: `/identifications/${encodeURIComponent(id)}/next-experiment.csv`,
              name: `${report.machine}-${id}-${next.motion_file}`,
            },
          ]}
        />
      )}
      <div class="actions">
        <a class="button" href="#/recalibrate">
          Record it in the guide
        </a>
      </div>
    </Panel>
  );
}

function rivals(next: Experiment, report: Report): string {
  const names = (next.separates ?? []).map((id) => title({ id, joint: next.joint ?? null }, report));
  return names.length === 0 ? "them" : names.join(" and ");
}
