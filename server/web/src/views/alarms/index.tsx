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

type Alarm = components["schemas"]["AlarmResource"];
type List = components["schemas"]["AlarmList"];

const SEVERITY: Record<Alarm["severity"], string> = { critical: "Alarm", warning: "Warning", info: "Note" };

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
      <h1 class="title">Alarms</h1>
      {alarms.error !== null && <Notice kind="bad">{alarms.error}</Notice>}
      {alarms.value === null && alarms.loading && <p role="status">Reading …</p>}
      <Panel title={`To be looked at (${open.length})`}>
        {open.length === 0 ? <Empty>Nothing is waiting for you.</Empty> : <Alarms alarms={open} />}
      </Panel>
      {seen.length > 0 && (
        <Panel title={`Acknowledged or silenced (${seen.length})`}>
          <Alarms alarms={seen} />
        </Panel>
      )}
      {over.length > 0 && (
        <Panel title={`Over (${over.length}${alarms.value?.next == null ? "" : " newest"})`}>
          <Alarms alarms={shown} />
          {shown.length < over.length && <Button onClick={() => setAll(true)}>Show all {over.length}</Button>}
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
            {SEVERITY[alarm.severity]}, {alarm.state === "active" ? "holds now" : "gone"}
          </Mark>
        </p>
        <p>
          <strong>{alarm.machine ?? "Service"}:</strong> {alarm.text}
        </p>
        <p class="hint">
          Since {time(alarm.raised)}
          {alarm.cleared !== null && `, gone ${time(alarm.cleared)}`}
          {alarm.count > 1 && `, came ${alarm.count} times`}
          {alarm.acknowledged && `, seen by ${alarm.acknowledged_by ?? "somebody"}`}
          {shelved &&
            `, kept quiet until ${time(alarm.shelved_until)} by ${alarm.shelved_by ?? "somebody"}: ${alarm.shelve_reason ?? ""}`}
        </p>
      </div>
      {session.may("operate") && <AlarmActions alarm={alarm} shelved={shelved} />}
    </li>
  );
}
