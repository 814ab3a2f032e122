/** Make a schedule, or change one. */
import { useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { CommandNotice, useCommand } from "../../command";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Button, Field, type InputEvent, Notice, type SelectEvent } from "../../ui/controls";
import { duration } from "../../ui/format";
import { Panel } from "../../ui/layout";
import { cronOf, ownZone, planOf } from "./cron";
import { When, useUpcoming } from "./when";
import { t } from "../../texts";

type Schedule = components["schemas"]["ScheduleResource"];
type Wish = components["schemas"]["ScheduleWish"];
type Excitations = components["schemas"]["ExcitationList"];

interface FormProps {
  machine: string;
  /** What is changed; null for a new one. */
  schedule: Schedule | null;
  onEnd: () => void;
}

export function ScheduleForm({ machine, schedule, onEnd }: FormProps) {
  const session = useSession();
  const command = useCommand();
  const read = useResource<Schedule>(schedule === null ? null : `/schedules/${schedule.id}`, []);
  const [label, setLabel] = useState(schedule?.label ?? "");
  const [plan, setPlan] = useState(planOf(schedule?.cron ?? "30 2 * * 1"));
  const [zone, setZone] = useState(schedule?.timezone ?? ownZone());
  const [motion, setMotion] = useState<"operation" | "standard">(schedule?.motion ?? "operation");
  const [minutes, setMinutes] = useState(String((schedule?.duration_s ?? 300) / 60));
  const [wait, setWait] = useState(String((schedule?.deadline_s ?? 3600) / 60));
  const [fit, setFit] = useState(schedule?.excitations?.[0] ?? "");
  const [judge, setJudge] = useState(schedule?.excitations?.[1] ?? "");
  const [activate, setActivate] = useState<"never" | "if_better">(schedule?.activate ?? "never");
  const place = `/excitations?machine=${encodeURIComponent(machine)}&limit=100`;
  const designed = useResource<Excitations>(place, ["excitations", "jobs"]);
  const motions = (designed.value?.items ?? []).filter((one) => one.state === "done" && one.rods !== "unpinned");

  const upcoming = useUpcoming(plan, zone);
  const seconds = 60 * Number(minutes);
  const deadline = 60 * Number(wait);
  const wrong = {
    minutes: seconds >= 30 && seconds <= 86400 ? null : t("schedules.betweenHalfMinute1440"),
    wait: deadline >= 10 && deadline <= 86400 ? null : t("schedules.between11440Minutes"),
    fit: motion === "standard" && fit === "" ? t("schedules.chooseMotionFitted") : null,
  };
  // What the service says of the times stands beside them already.
  const times = cronOf(plan) !== "" && upcoming.error === null;
  const good = times && wrong.wait === null && (motion === "operation" ? wrong.minutes === null : wrong.fit === null);

  const send = (): void => {
    const kept = schedule === null ? {} : { options: schedule.options, enabled: schedule.enabled };
    const json = {
      ...kept,
      machine,
      label,
      cron: cronOf(plan),
      timezone: zone,
      motion,
      duration_s: wrong.minutes === null ? seconds : 300,
      deadline_s: deadline,
      excitations: motion === "standard" ? [fit, judge].filter(Boolean) : [],
      activate,
    } satisfies Partial<Wish>;
    const order =
      schedule === null
        ? ({ method: "POST", path: "/schedules", json } as const)
        : ({ method: "PUT", path: `/schedules/${schedule.id}`, json, etag: read.etag } as const);
    void command.run(order, onEnd);
  };

  return (
    <Panel title={schedule === null ? t("schedules.newSchedule") : t("schedules.change", { label: schedule.label })}>
      <form
        onInput={() => command.say(null)} // what was said is of the form as it was
        onSubmit={(event) => {
          event.preventDefault();
          send();
        }}
      >
        <Field label={t("schedules.nameOptional")}>
          <input
            value={label}
            maxLength={200}
            autocomplete="off"
            onInput={(event: InputEvent) => setLabel(event.currentTarget.value)}
          />
        </Field>
        <When plan={plan} zone={zone} upcoming={upcoming} onPlan={setPlan} onZone={setZone} />
        <div class="columns">
          <Field
            label={t("schedules.whatIsRecorded")}
            hint={motion === "operation" ? t("schedules.nobodyHasDoAnything") : t("schedules.serviceWaitsUntilMotion")}
          >
            {(attributes) => (
              <select
                {...attributes}
                value={motion}
                onChange={(event: SelectEvent) => setMotion(event.currentTarget.value as typeof motion)}
              >
                <option value="operation">{t("common.normalWork")}</option>
                <option value="standard">{t("schedules.aDesignedMotion")}</option>
              </select>
            )}
          </Field>
          {motion === "operation" && (
            <Field label={t("schedules.howManyMinutes")} error={wrong.minutes}>
              {(attributes) => (
                <input
                  {...attributes}
                  inputMode="decimal"
                  value={minutes}
                  onInput={(event: InputEvent) => setMinutes(event.currentTarget.value)}
                />
              )}
            </Field>
          )}
          {motion === "standard" && (
            <>
              <MotionField
                label={t("schedules.motionToFit")}
                value={fit}
                motions={motions}
                error={wrong.fit}
                onChange={setFit}
              />
              <MotionField
                label={t("schedules.motionJudgeOptional")}
                value={judge}
                motions={motions}
                onChange={setJudge}
              />
            </>
          )}
          <Field label={t("schedules.minutesWaitMachine")} hint={t("schedules.afterSlotCountsAs")} error={wrong.wait}>
            {(attributes) => (
              <input
                {...attributes}
                inputMode="decimal"
                value={wait}
                onInput={(event: InputEvent) => setWait(event.currentTarget.value)}
              />
            )}
          </Field>
          <Field label={t("schedules.whatHappensWithNew")}>
            <select
              value={activate}
              onChange={(event: SelectEvent) => setActivate(event.currentTarget.value as typeof activate)}
            >
              <option value="never">{t("schedules.proposedPersonDecides")}</option>
              <option value="if_better">{t("schedules.ifBetterUsedAt")}</option>
            </select>
          </Field>
        </div>
        {activate === "if_better" && <Notice kind="warning">{t("schedules.nobodyLooksAtModel")}</Notice>}
        {motion === "standard" && designed.value !== null && motions.length === 0 && (
          <Notice kind="warning">{t("schedules.noMotionWasDesigned")}</Notice>
        )}
        <CommandNotice of={command} />
        <div class="actions">
          <Button
            kind="primary"
            type="submit"
            busy={command.busy}
            disabled={!good || !session.online.value || (schedule !== null && read.etag === null)}
          >
            {schedule === null ? t("schedules.createSchedule") : t("schedules.save")}
          </Button>
          <Button onClick={onEnd}>{t("common.goBack")}</Button>
        </div>
      </form>
    </Panel>
  );
}

interface MotionFieldProps {
  label: string;
  value: string;
  motions: Excitations["items"];
  error?: string | null;
  onChange: (id: string) => void;
}

function MotionField({ label, value, motions, error, onChange }: MotionFieldProps) {
  return (
    <Field label={label} error={error}>
      {(attributes) => (
        <select {...attributes} value={value} onChange={(event: SelectEvent) => onChange(event.currentTarget.value)}>
          <option value="">–</option>
          {value !== "" && !motions.some((one) => one.id === value) && <option value={value}>{value}</option>}
          {motions.map((one) => (
            <option key={one.id} value={one.id}>
              {one.label} ({duration(one.seconds)})
            </option>
          ))}
        </select>
      )}
    </Field>
  );
}
