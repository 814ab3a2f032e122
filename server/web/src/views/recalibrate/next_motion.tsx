/** After an identification that left several causes: the motion that it designed, as the next one to record. */
import { useResource } from "../../resource";
import { randomName } from "../../net/random";
import { Button, Notice } from "../../ui/controls";
import { type NextExperiment, readReport, type Report } from "../results/report";
import { capital, readable } from "../results/wording";
import { type Guide, MOST_CLOSINGS } from "./progress";
import { t } from "../../texts";

interface NextMotionProps {
  identification: string;
  guide: Guide;
  keep: (change: Partial<Guide> | null) => void;
}

/** The next experiment of a report, if it is a motion that was designed and written. */
export function designed(report: Report | null): NextExperiment | null {
  const next = report?.loop.next_experiment ?? null;
  return next !== null && typeof next !== "string" && next.kind != null && next.motion_file ? next : null;
}

export function NextMotion({ identification, guide, keep }: NextMotionProps) {
  const file = useResource<unknown>(`/identifications/${encodeURIComponent(identification)}/report.json`, []);
  const report = file.value === null ? null : readReport(file.value);
  const next = designed(report);
  if (next === null || report === null) return null;
  const text = capital(readable(next.motion ?? "", report, next.joint ?? null));
  if (guide.closings.length >= MOST_CLOSINGS)
    return <Notice kind="info">{t("recalibrate.severalCausesStillPossible", { mostclosings: MOST_CLOSINGS })}</Notice>;
  return (
    <Notice kind="info">
      <p>
        {t("recalibrate.severalCausesFitThese")} <strong>{text}</strong>
      </p>
      {next.why && <p>{capital(readable(next.why, report, next.joint ?? null))}.</p>}
      <p>{t("recalibrate.whatWasRecordedSo")}</p>
      <Button
        kind="primary"
        onClick={() =>
          keep({
            closings: [
              ...guide.closings,
              { identification, rods: next.rods === "unpinned" ? "unpinned" : "pinned", text },
            ],
            attempt: guide.attempt + 1,
            key: randomName(),
          })
        }
      >
        {t("recalibrate.recordMotionNext")}
      </Button>
    </Notice>
  );
}
