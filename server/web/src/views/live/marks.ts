/** What happened, as marks on the plots: alarms, and recordings from their start to their end. */
import type { components } from "../../net/api.gen";
import type { ChartMark } from "../../charts/overlays";
import { useResource } from "../../resource";
import { said } from "../../texts/report";

type Alarm = components["schemas"]["AlarmResource"];
type Recording = components["schemas"]["RecordingResource"];

const seconds = (iso: string): number => new Date(iso).getTime() / 1000;
/** What goes on now lasts to the right edge. */
const ON = 1e11;

export function marksOf(machine: string, alarms: Alarm[], recordings: Recording[]): ChartMark[] {
  const found: ChartMark[] = alarms
    .filter((alarm) => alarm.machine === machine)
    .map((alarm) => ({
      kind: "alarm",
      from: seconds(alarm.raised),
      to: alarm.cleared === null ? ON : seconds(alarm.cleared),
      text: said(alarm.text, alarm.text_message),
    }));
  for (const one of recordings)
    if (one.origin === "recorded")
      found.push({
        kind: "recording",
        from: seconds(one.created),
        to: one.ended === null ? ON : seconds(one.ended),
        text: one.label || one.id,
      });
  return found.sort((a, b) => b.from - a.from);
}

export function useMarks(machine: string): ChartMark[] {
  const alarms = useResource<components["schemas"]["AlarmList"]>("/alarms?limit=200", "alarms");
  const path = `/recordings?machine=${encodeURIComponent(machine)}&limit=50`;
  const recordings = useResource<components["schemas"]["RecordingList"]>(path, "recordings");
  return marksOf(machine, alarms.value?.items ?? [], recordings.value?.items ?? []);
}
