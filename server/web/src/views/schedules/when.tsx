/** When a schedule runs: plain presets or a cron expression, the time zone, and what comes out of it. */
import type { components } from "../../net/api.gen";
import { query } from "../../net/client";
import { type Resource, useResource } from "../../resource";
import { Field, type InputEvent, Notice, type SelectEvent } from "../../ui/controls";
import { useSettled } from "../settled";
import { type Every, type Plan, WEEKDAYS, cronOf, timeZones, two } from "./cron";
import { t } from "../../texts";
import { inZone } from "../../ui/format";

type Upcoming = components["schemas"]["UpcomingSlots"];

/** The next five times, as the service counts them; nothing is asked of an expression that is not there yet. */
export function useUpcoming(plan: Plan, zone: string): Resource<Upcoming> {
  const cron = useSettled(cronOf(plan));
  return useResource<Upcoming>(cron === "" ? null : `/schedules/upcoming${query({ cron, timezone: zone })}`, []);
}

interface WhenProps {
  plan: Plan;
  zone: string;
  upcoming: Resource<Upcoming>;
  onPlan: (plan: Plan) => void;
  onZone: (zone: string) => void;
}

export function When({ plan, zone, upcoming, onPlan, onZone }: WhenProps) {
  const days = Array.from({ length: 28 }, (_, index) => index + 1);
  const cron = cronOf(plan);
  return (
    <>
      <div class="columns">
        <Field label={t("schedules.howOften")}>
          <select
            value={plan.every}
            onChange={(event: SelectEvent) => {
              const every = event.currentTarget.value as Every;
              onPlan({ ...plan, every, own: every === "own" ? cron : plan.own });
            }}
          >
            <option value="day">{t("schedules.everyDay")}</option>
            <option value="week">{t("schedules.everyWeek")}</option>
            <option value="month">{t("schedules.everyMonth")}</option>
            <option value="own">{t("schedules.cronExpression")}</option>
          </select>
        </Field>
        {plan.every === "week" && (
          <Field label={t("schedules.dayWeek")}>
            <select
              value={String(plan.weekday)}
              onChange={(event: SelectEvent) => onPlan({ ...plan, weekday: Number(event.currentTarget.value) })}
            >
              {WEEKDAYS.map((name, index) => (
                <option key={name} value={String(index)}>
                  {name}
                </option>
              ))}
            </select>
          </Field>
        )}
        {plan.every === "month" && (
          <Field label={t("schedules.dayMonth")}>
            <select
              value={String(plan.day)}
              onChange={(event: SelectEvent) => onPlan({ ...plan, day: Number(event.currentTarget.value) })}
            >
              {days.map((day) => (
                <option key={day} value={String(day)}>
                  {day}
                </option>
              ))}
            </select>
          </Field>
        )}
        {plan.every === "own" ? (
          <Field label={t("schedules.cronExpression2")} hint={t("schedules.minuteHourDayMonth")}>
            {(attributes) => (
              <input
                {...attributes}
                class="mono"
                value={plan.own}
                maxLength={200}
                autocomplete="off"
                onInput={(event: InputEvent) => onPlan({ ...plan, own: event.currentTarget.value })}
              />
            )}
          </Field>
        ) : (
          <Field label={t("schedules.timeOfDay")}>
            <input
              type="time"
              required
              value={`${two(plan.hour)}:${two(plan.minute)}`}
              onInput={(event: InputEvent) => {
                const [hour, minute] = event.currentTarget.value.split(":").map(Number);
                if (hour !== undefined && minute !== undefined) onPlan({ ...plan, hour, minute });
              }}
            />
          </Field>
        )}
        <Field label={t("schedules.timeZone")}>
          <select value={zone} onChange={(event: SelectEvent) => onZone(event.currentTarget.value)}>
            {timeZones(zone).map((name) => (
              <option key={name} value={name}>
                {name}
              </option>
            ))}
          </select>
        </Field>
      </div>
      {cron === "" ? (
        <p class="hint">{t("schedules.writeExpressionSeeIts")}</p>
      ) : (
        <NextTimes upcoming={upcoming} zone={zone} />
      )}
    </>
  );
}

function NextTimes({ upcoming, zone }: { upcoming: Resource<Upcoming>; zone: string }) {
  if (upcoming.error !== null) return <Notice kind="bad">{upcoming.error}</Notice>;
  if (upcoming.value === null) return <p role="status">{t("common.reading")}</p>;
  return (
    <div class="next-times" role="status">
      <p>
        <strong>{t("schedules.theNextTimes")}</strong> <span class="hint">{t("schedules.in", { zone })}</span>
      </p>
      <ol>
        {upcoming.value.slots.map((slot) => (
          <li key={slot}>{inZone(slot, zone)}</li>
        ))}
      </ol>
    </div>
  );
}
