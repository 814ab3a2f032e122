/** On every page: alarms that nobody acknowledged. */
import type { components } from "../net/api.gen";
import { useRoute } from "../routes";
import { useResource } from "../resource";
import { Icon } from "../ui/icons";
import { t } from "../texts";
import { said } from "../texts/report";

type Alarm = components["schemas"]["AlarmResource"];

/** Alarms that a person has to look at: not acknowledged, and not kept quiet at `now` (ms). */
export function waiting(alarms: Alarm[], now: number): Alarm[] {
  return alarms.filter(
    (alarm) => !alarm.acknowledged && (alarm.shelved_until === null || new Date(alarm.shelved_until).getTime() <= now),
  );
}

const WORST = { critical: 2, warning: 1, info: 0 } as const;

export function AlarmBanner() {
  const route = useRoute();
  const alarms = useResource<components["schemas"]["AlarmList"]>("/alarms?limit=200", "alarms");
  const open = waiting(alarms.value?.items ?? [], Date.now()).sort((a, b) => WORST[b.severity] - WORST[a.severity]);
  const first = open[0];
  if (first === undefined || route.path[0] === "alarms") return null;
  const more = open.length > 1 ? t("shell.andMore", { count: open.length - 1 }) : "";
  const word =
    first.severity === "critical"
      ? t("shell.alarm")
      : first.severity === "warning"
        ? t("shell.warning")
        : t("shell.note");
  return (
    <div role="alert">
      <a class={`alarm-banner ${first.severity}`} href="#/alarms">
        <Icon name="alarm" />
        <span>
          <strong>{word}:</strong> {first.machine === null ? "" : `${first.machine}: `}
          {said(first.text, first.text_message)}
          {first.state === "cleared" && t("shell.hasGoneNobodyHas")}
          {more}
        </span>
        <span class="look">{t("shell.view")}</span>
      </a>
    </div>
  );
}
