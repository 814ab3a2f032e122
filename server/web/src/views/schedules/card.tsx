/** One schedule: when and how, what became of its slots, run it now, switch it, change it, delete it. */
import { useEffect, useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { go } from "../../routes";
import { CommandNotice, useCommand } from "../../command";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Button, Mark, Notice, type NoticeKind } from "../../ui/controls";
import { duration, inZone } from "../../ui/format";
import { Confirm, Empty, Panel, Table } from "../../ui/layout";
import { cronWords } from "./cron";
import { t } from "../../texts";
import { said } from "../../texts/report";

type Schedule = components["schemas"]["ScheduleResource"];
type Slots = components["schemas"]["SlotList"];
type Slot = components["schemas"]["SlotResource"];
type Job = components["schemas"]["JobResource"];

const SLOTS: Record<Slot["state"], [NoticeKind | "off", string]> = {
  running: ["info", t("schedules.running")],
  done: ["good", t("schedules.done")],
  failed: ["bad", t("common.failed")],
  missed: ["warning", t("schedules.missed")],
  coalesced: ["off", t("schedules.togetherWithLaterOne")],
};

interface CardProps {
  schedule: Schedule;
  onEdit: () => void;
  onDone: () => void;
}

export function ScheduleCard({ schedule, onEdit, onDone }: CardProps) {
  const session = useSession();
  const command = useCommand();
  const [asked, setAsked] = useState<"run" | "delete" | null>(null);
  // What is changed or deleted is what was read: its ETag goes along.
  // It is read again when the list shows another one, and not when it is gone from there.
  const read = useResource<Schedule>(`/schedules/${schedule.id}`, []);
  const shown = JSON.stringify(schedule);
  useEffect(() => read.reload(), [shown]);
  const away = !session.online.value;
  const zone = schedule.timezone ?? "UTC";
  const enabled = schedule.enabled ?? true;
  const switchTo = (wanted: boolean): void => {
    if (read.value === null) return;
    const { id: _id, created: _created, next: _next, last: _last, ...wish } = read.value;
    const json = { ...wish, enabled: wanted };
    void command.run({ method: "PUT", path: `/schedules/${schedule.id}`, json, etag: read.etag }, onDone);
  };
  return (
    <Panel
      title={schedule.label || schedule.id}
      actions={
        <Mark kind={enabled ? "good" : "off"}>{enabled ? t("schedules.runs") : t("schedules.switchedOff")}</Mark>
      }
    >
      <p>
        <strong>{cronWords(schedule.cron)}</strong> ({zone}): {what(schedule)}
      </p>
      <p class="hint">
        {schedule.next === null
          ? t("schedules.noNextTime")
          : t("schedules.next", { next: inZone(schedule.next, zone) })}{" "}
        {schedule.last === null
          ? t("schedules.itNeverRan")
          : t("schedules.last", { last: inZone(schedule.last, zone) })}
      </p>
      <CommandNotice of={command} />
      <div class="actions">
        {session.may("operate") && (
          <Button kind="primary" busy={command.busy} disabled={away} onClick={() => setAsked("run")}>
            {t("schedules.runNow")}
          </Button>
        )}
        {session.may("engineer") && (
          <>
            <Button busy={command.busy} disabled={away || read.value === null} onClick={() => switchTo(!enabled)}>
              {enabled ? t("schedules.switchOff") : t("schedules.switchOn")}
            </Button>
            <Button disabled={away} onClick={onEdit}>
              {t("schedules.changeIt")}
            </Button>
            <Button busy={command.busy} disabled={away || read.etag === null} onClick={() => setAsked("delete")}>
              {t("common.delete")}
            </Button>
          </>
        )}
      </div>
      <SlotHistory schedule={schedule} zone={zone} />
      {asked === "run" && (
        <Confirm
          title={t("schedules.runNow2", { label: schedule.label })}
          text={t("schedules.recordsFits", {
            motion:
              schedule.motion === "standard"
                ? t("schedules.theDesignedMotion")
                : t("schedules.normalWorkFor", { durationS: duration(schedule.duration_s) }),
            activate:
              schedule.activate === "if_better"
                ? t("schedules.usesNewCalibrationIf")
                : t("schedules.proposesACalibration"),
          })}
          confirm={t("schedules.runItNow")}
          onNo={() => setAsked(null)}
          onYes={() => {
            setAsked(null);
            void command.run<Job>({ method: "POST", path: `/schedules/${schedule.id}/run` }, (job) =>
              go(`#/jobs/${job.id}`),
            );
          }}
        />
      )}
      {asked === "delete" && (
        <Confirm
          title={t("schedules.delete", { label: schedule.label })}
          text={t("schedules.doesNotRunAny")}
          confirm={t("common.deleteIt")}
          kind="danger"
          onNo={() => setAsked(null)}
          onYes={() => {
            setAsked(null);
            void command.run({ method: "DELETE", path: `/schedules/${schedule.id}`, etag: read.etag }, onDone);
          }}
        />
      )}
    </Panel>
  );
}

/** What a slot does, in a line. */
export function what(schedule: Schedule): string {
  const record =
    schedule.motion === "standard"
      ? t("schedules.designedMotionRecordedWaits", { deadlineS: duration(schedule.deadline_s) })
      : t("schedules.normalWorkRecorded", { durationS: duration(schedule.duration_s) });
  const then =
    schedule.activate === "if_better"
      ? t("schedules.newCalibrationUsedAt")
      : t("schedules.newCalibrationProposedPerson");
  return `${record}; ${then}.`;
}

function SlotHistory({ schedule, zone }: { schedule: Schedule; zone: string }) {
  const [open, setOpen] = useState(false);
  const path = open ? `/schedules/${schedule.id}/slots?limit=50` : null;
  const slots = useResource<Slots>(path, ["schedules", "jobs"]);
  return (
    <details open={open} onToggle={(event) => setOpen(event.currentTarget.open)}>
      <summary>{t("schedules.runHistory")}</summary>
      {slots.error !== null && <Notice kind="bad">{slots.error}</Notice>}
      {slots.value === null ? (
        slots.loading && <p role="status">{t("common.reading")}</p>
      ) : slots.value.items.length === 0 ? (
        <Empty>{t("schedules.noneHadItsTurn")}</Empty>
      ) : (
        <Table
          caption={t("schedules.timesOf", { label: schedule.label })}
          columns={[
            { name: "slot", title: t("schedules.time", { zone }) },
            { name: "state", title: t("schedules.outcome") },
            { name: "note", title: t("schedules.note") },
            { name: "links", title: "" },
          ]}
          rows={slots.value.items.map((slot) => ({
            key: slot.slot,
            slot: inZone(slot.slot, zone),
            state: <Mark kind={SLOTS[slot.state][0]}>{SLOTS[slot.state][1]}</Mark>,
            note: said(slot.note, slot.note_message),
            links:
              slot.calibration !== null ? (
                <a href="#/calibrations">{t("schedules.calibration")}</a>
              ) : slot.job !== null ? (
                <a href={`#/jobs/${slot.job}`}>{t("common.job")}</a>
              ) : (
                ""
              ),
          }))}
        />
      )}
    </details>
  );
}
