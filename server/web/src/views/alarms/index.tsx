/** What is wrong, who has seen it, what is kept quiet. */
import { useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Mark, Notice } from "../../ui/controls";
import { Button } from "../../ui/controls";
import { time } from "../../ui/format";
import { Empty, Panel } from "../../ui/layout";
import { AlarmActions } from "./actions";
import { t } from "../../texts";
import { said } from "../../texts/report";

type Alarm = components["schemas"]["AlarmResource"];
type List = components["schemas"]["AlarmList"];

const SEVERITY: Record<Alarm["severity"], string> = {
  critical: t("alarms.alarm"),
  warning: t("alarms.warning"),
  info: t("alarms.note"),
};

export function quiet(alarm: Alarm, now: number): boolean {
  return alarm.shelved_until !== null && new Date(alarm.shelved_until).getTime() > now;
}

/** Those that need somebody, those that hold but were seen or are kept quiet, and those that are over. */
export function sorted(alarms: Alarm[], now: number): { open: Alarm[]; seen: Alarm[]; over: Alarm[] } {
  const open = alarms.filter((alarm) => !alarm.acknowledged && !quiet(alarm, now));
  const seen = alarms.filter((alarm) => !open.includes(alarm) && (alarm.state === "active" || quiet(alarm, now)));
  return { open, seen, over: alarms.filter((alarm) => !open.includes(alarm) && !seen.includes(alarm)) };
}

const FIRST = 25;

export default function AlarmsView() {
  const alarms = useResource<List>("/alarms?limit=200", "alarms");
  const [all, setAll] = useState(false);
  const { open, seen, over } = sorted(alarms.value?.items ?? [], Date.now());
  const shown = all ? over : over.slice(0, FIRST);
  return (
    <div class={alarms.stale ? "stale" : ""}>
      <h1 class="title">{t("common.alarms")}</h1>
      {alarms.error !== null && <Notice kind="bad">{alarms.error}</Notice>}
      {alarms.value === null && alarms.loading && <p role="status">{t("common.reading")}</p>}
      <Panel title={t("alarms.lookedAt", { count: open.length })}>
        {open.length === 0 ? <Empty>{t("alarms.nothingWaitingYou")}</Empty> : <Alarms alarms={open} />}
      </Panel>
      {seen.length > 0 && (
        <Panel title={t("alarms.acknowledgedOrSilenced", { count: seen.length })}>
          <Alarms alarms={seen} />
        </Panel>
      )}
      {over.length > 0 && (
        <Panel
          title={t("alarms.over", { count: over.length, next: alarms.value?.next == null ? "" : t("alarms.newest") })}
        >
          <Alarms alarms={shown} />
          {shown.length < over.length && (
            <Button onClick={() => setAll(true)}>{t("common.showAll", { count: over.length })}</Button>
          )}
        </Panel>
      )}
    </div>
  );
}

function Alarms({ alarms }: { alarms: Alarm[] }) {
  return (
    <ul class="alarms">
      {alarms.map((alarm) => (
        <AlarmItem key={alarm.id} alarm={alarm} />
      ))}
    </ul>
  );
}

function AlarmItem({ alarm }: { alarm: Alarm }) {
  const session = useSession();
  const shelved = quiet(alarm, Date.now());
  const kind = alarm.severity === "critical" ? "bad" : alarm.severity;
  return (
    <li class={`alarm ${alarm.state === "active" ? kind : "off"}`}>
      <div class="alarm-text">
        <p>
          <Mark kind={alarm.state === "active" ? kind : "off"}>
            {SEVERITY[alarm.severity]}, {alarm.state === "active" ? t("common.holdsNow") : t("alarms.gone")}
          </Mark>
        </p>
        <p>
          <strong>{alarm.machine ?? t("alarms.service")}:</strong> {said(alarm.text, alarm.text_message)}
        </p>
        <p class="hint">
          {t("alarms.since", {
            raised: time(alarm.raised),
            gone: alarm.cleared !== null ? t("alarms.gone2", { cleared: time(alarm.cleared) }) : "",
            times: alarm.count > 1 ? t("alarms.cameTimes", { count: alarm.count }) : "",
            seen: alarm.acknowledged
              ? t("alarms.seenBy", { acknowledgedBy: alarm.acknowledged_by ?? t("alarms.somebody") })
              : "",
            quiet: shelved
              ? t("alarms.keptQuietUntil", {
                  shelvedUntil: time(alarm.shelved_until),
                  shelvedBy: alarm.shelved_by ?? t("alarms.somebody"),
                  shelveReason: alarm.shelve_reason ?? "",
                })
              : "",
          })}
        </p>
      </div>
      {session.may("operate") && <AlarmActions alarm={alarm} shelved={shelved} />}
    </li>
  );
}
