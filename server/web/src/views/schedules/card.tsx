/** One schedule: when and how, what became of its slots, run it now, switch it, change it, delete it. */
import { useEffect, useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { go } from "../../routes";
import { CommandNotice, useCommand } from "../../command";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Button, Mark, Notice, type NoticeKind } from "../../ui/controls";
import { duration } from "../../ui/format";
import { Confirm, Empty, Panel, Table } from "../../ui/layout";
import { cronWords, inZone } from "./cron";

type Schedule = components["schemas"]["ScheduleResource"];
type Slots = components["schemas"]["SlotList"];
type Slot = components["schemas"]["SlotResource"];
type Job = components["schemas"]["JobResource"];

const SLOTS: Record<Slot["state"], [NoticeKind | "off", string]> = {
  running: ["info", "Running"],
  done: ["good", "Done"],
  failed: ["bad", "Failed"],
  missed: ["warning", "Missed"],
  coalesced: ["off", "Together with a later one"],
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
      actions={<Mark kind={enabled ? "good" : "off"}>{enabled ? "Runs" : "Switched off"}</Mark>}
    >
      <p>
        <strong>{cronWords(schedule.cron)}</strong> ({zone}): {what(schedule)}
      </p>
      <p class="hint">
        {schedule.next === null ? "No next time." : `Next: ${inZone(schedule.next, zone)}.`}{" "}
        {schedule.last === null ? "It never ran." : `Last: ${inZone(schedule.last, zone)}.`}
      </p>
      <CommandNotice of={command} />
      <div class="actions">
        {session.may("operate") && (
          <Button kind="primary" busy={command.busy} disabled={away} onClick={() => setAsked("run")}>
            Run now
          </Button>
        )}
        {session.may("engineer") && (
          <>
            <Button busy={command.busy} disabled={away || read.value === null} onClick={() => switchTo(!enabled)}>
              {enabled ? "Switch off" : "Switch on"}
            </Button>
            <Button disabled={away} onClick={onEdit}>
              Change
            </Button>
            <Button busy={command.busy} disabled={away || read.etag === null} onClick={() => setAsked("delete")}>
              Delete
            </Button>
          </>
        )}
      </div>
      <SlotHistory schedule={schedule} zone={zone} />
      {asked === "run" && (
        <Confirm
          title={`Run “${schedule.label}” now?`}
          text={`It records ${
            schedule.motion === "standard" ? "the designed motion" : `normal work for ${duration(schedule.duration_s)}`
          }, fits and ${schedule.activate === "if_better" ? "uses the new calibration if it is better" : "proposes a calibration"}.`}
          confirm="Run it now"
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
          title={`Delete “${schedule.label}”?`}
          text="It does not run any more. Its results and calibrations stay."
          confirm="Delete it"
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
      ? `the designed motion is recorded (waits up to ${duration(schedule.deadline_s)})`
      : `normal work is recorded for ${duration(schedule.duration_s)}`;
  const then =
    schedule.activate === "if_better"
      ? "a new calibration is used at once if it is better"
      : "a new calibration is proposed, and a person decides";
  return `${record}; ${then}.`;
}

function SlotHistory({ schedule, zone }: { schedule: Schedule; zone: string }) {
  const [open, setOpen] = useState(false);
  const path = open ? `/schedules/${schedule.id}/slots?limit=50` : null;
  const slots = useResource<Slots>(path, ["schedules", "jobs"]);
  return (
    <details open={open} onToggle={(event) => setOpen(event.currentTarget.open)}>
      <summary>Run history</summary>
      {slots.error !== null && <Notice kind="bad">{slots.error}</Notice>}
      {slots.value === null ? (
        slots.loading && <p role="status">Reading …</p>
      ) : slots.value.items.length === 0 ? (
        <Empty>None had its turn yet.</Empty>
      ) : (
        <Table
          caption={`Times of ${schedule.label}`}
          columns={[
            { name: "slot", title: `Time (${zone})` },
            { name: "state", title: "What became of it" },
            { name: "note", title: "Note" },
            { name: "links", title: "" },
          ]}
          rows={slots.value.items.map((slot) => ({
            key: slot.slot,
            slot: inZone(slot.slot, zone),
            state: <Mark kind={SLOTS[slot.state][0]}>{SLOTS[slot.state][1]}</Mark>,
            note: slot.note,
            links:
              slot.calibration !== null ? (
                <a href="#/calibrations">Calibration</a>
              ) : slot.job !== null ? (
                <a href={`#/jobs/${slot.job}`}>Job</a>
              ) : (
                ""
              ),
          }))}
        />
      )}
    </details>
  );
}
