/** What to record next to tell apart what these recordings could not: a motion where one helps, else what else does. */
import { Panel } from "../../ui/layout";
import { Downloads } from "../downloads";
import type { NextExperiment as Experiment, Report } from "./report";
import { capital, readable, title } from "./wording";
import { t } from "../../texts";

export function NextExperiment({ id, report }: { id: string; report: Report }) {
  const next = report.loop.next_experiment;
  if (next === null || next === "") return null;
  const joint = typeof next === "string" ? null : (next.joint ?? null);
  const said = (text: string): string => capital(readable(text, report, joint));
  if (typeof next === "string")
    return (
      <Panel title={t("results.nextExperiment")}>
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
    <Panel title={t("results.nextExperiment")}>
      {motion ? (
        <p>
          <strong>{said(next.motion ?? "")}</strong>
        </p>
      ) : (
        <>
          <p>
            <strong>{t("results.tellApartRecordOnce", { next: rivals(next, report) })}</strong>
          </p>
          {other}
        </>
      )}
      {next.why && <p>{said(next.why)}.</p>}
      {motion && <p class="hint">{t("results.itTellsApart", { next: rivals(next, report) })}</p>}
      {motion && otherwise.length > 0 && (
        <details>
          <summary>{t("results.whatElseWouldTell")}</summary>
          {other}
        </details>
      )}
      {next.motion_file && (
        <Downloads
          files={[
            {
              title: t("results.thisMotionCsv"),
              path: `/identifications/${encodeURIComponent(id)}/next-experiment.csv`,
              name: `${report.machine}-${id}-${next.motion_file}`,
            },
          ]}
        />
      )}
      <div class="actions">
        <a class="button" href="#/recalibrate">
          {t("results.recordGuide")}
        </a>
      </div>
    </Panel>
  );
}

function rivals(next: Experiment, report: Report): string {
  const names = (next.separates ?? []).map((id) => title({ id, joint: next.joint ?? null }, report));
  return names.length === 0 ? t("results.them") : names.join(t("results.and"));
}
