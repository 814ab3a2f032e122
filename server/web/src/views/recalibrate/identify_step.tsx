/** The last step: order the identification once, follow its job to the result. */
import type { components } from "../../net/api.gen";
import { CommandNotice, useCommand } from "../../command";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Button, Notice } from "../../ui/controls";
import { fixed } from "../../ui/format";
import { Table } from "../../ui/layout";
import { ROLE_WORDS, type Role } from "../../words";
import { JobPanel, over } from "../jobs";
import { randomName } from "../../net/random";
import { NextMotion } from "./next_motion";
import { type Guide, RECORDED, type closingsOf, orderLabel, type recordingsOf } from "./progress";
import { t } from "../../texts";

type Identifications = components["schemas"]["IdentificationList"];
type Identification = components["schemas"]["IdentificationResource"];
type Job = components["schemas"]["JobResource"];

interface IdentifyProps {
  machine: string;
  guide: Guide;
  recordings: ReturnType<typeof recordingsOf>;
  closings: ReturnType<typeof closingsOf>;
  keep: (change: Partial<Guide> | null) => void;
}

export function IdentifyStep({ machine, guide, recordings, closings, keep }: IdentifyProps) {
  const session = useSession();
  const command = useCommand();
  const path = `/identifications?machine=${encodeURIComponent(machine)}&limit=100`;
  const list = useResource<Identifications>(path, "identifications");
  const mine = list.value?.items.find((one) => one.label === orderLabel(guide));
  const job = useResource<Job>(mine === undefined ? null : `/jobs/${mine.job}`, "jobs");
  const chosen = [...RECORDED.map((role) => recordings[role]), ...closings].filter((one) => one !== undefined);

  if (mine !== undefined)
    return (
      <>
        {job.error !== null && job.value === null && <Notice kind="bad">{job.error}</Notice>}
        {job.value !== null && <JobPanel job={job.value} />}
        {job.value?.state === "done" && <NextMotion identification={mine.id} guide={guide} keep={keep} />}
        {job.value !== null && over(job.value) && (
          <div class="actions">
            {job.value.state === "done" ? (
              <Button onClick={() => keep(null)}>{t("recalibrate.finishThisGuide")}</Button>
            ) : (
              <Button kind="primary" onClick={() => keep({ attempt: guide.attempt + 1, key: randomName() })}>
                {t("recalibrate.tryAgain")}
              </Button>
            )}
          </div>
        )}
      </>
    );
  if (list.value === null) return <p role="status">{t("common.reading")}</p>;
  return (
    <>
      <p>{t("recalibrate.theseRecordingsUsed")}</p>
      <Table
        caption={t("recalibrate.recordingsGuide")}
        columns={[
          { name: "role", title: t("recalibrate.recording") },
          { name: "rows", title: t("common.rows"), align: "right" },
          { name: "again", title: "", align: "right" },
        ]}
        rows={chosen.map((one) => ({
          key: one.id,
          role: closings.includes(one)
            ? t("recalibrate.motionTellsCausesApart")
            : (ROLE_WORDS[one.role as Role] ?? one.role),
          again: (
            <Button
              label={t("recalibrate.recordAgain", { role: ROLE_WORDS[one.role as Role] ?? one.role })}
              onClick={() =>
                keep({ dropped: [...guide.dropped, one.id], ...(closings.includes(one) ? {} : redo(one.role)) })
              }
            >
              {t("recalibrate.recordAgain2")}
            </Button>
          ),
          rows: typeof one.statistics.rows === "number" ? fixed(one.statistics.rows, 0) : "",
        }))}
      />
      <CommandNotice of={command} />
      <Button
        kind="primary"
        busy={command.busy}
        disabled={!session.online.value || list.stale}
        onClick={() => {
          const json = { machine, label: orderLabel(guide), recordings: chosen.map((one) => ({ id: one.id })) };
          const order = { method: "POST", path: "/identifications", json, key: guide.key } as const;
          void command.run<Identification>(order, list.reload);
        }}
      >
        {t("common.identify")}
      </Button>
    </>
  );
}

/** The free cylinders have to be free again. */
function redo(role: string): Partial<Guide> {
  return role === "unloaded" ? { unpinned: false, pinned: false } : {};
}
