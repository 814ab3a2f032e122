/** A machine over months: calibrations, effects, drifts, alarms and its file, as one time line. */
import { useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Button, Field, Mark, Notice, type SelectEvent } from "../../ui/controls";
import { count, time } from "../../ui/format";
import { Empty, Panel, Table } from "../../ui/layout";
import { href, KINDS, type Kind, LANES, sentence, tone } from "./events";
import { Timeline } from "./timeline";
import "./history.css";

type History = components["schemas"]["History"];

const SPANS: [number, string][] = [
  [7, "one week"],
  [30, "30 days"],
  [90, "90 days"],
  [365, "one year"],
  [1826, "five years"],
];
const FIRST = 50;
const WATCHED = ["machines", "calibrations", "identifications", "alarms", "jobs"];

export default function HistoryView() {
  const session = useSession();
  const machine = session.machine.value;
  return (
    <>
      <h1 class="title">History {machine !== null && <span class="hint">{machine}</span>}</h1>
      {machine === null ? <Empty>There is no machine yet.</Empty> : <MachineHistory key={machine} machine={machine} />}
    </>
  );
}

function MachineHistory({ machine }: { machine: string }) {
  const [days, setDays] = useState(90);
  const [hidden, setHidden] = useState<Kind[]>([]);
  const [all, setAll] = useState(false);
  const history = useResource<History>(`/machines/${encodeURIComponent(machine)}/history?days=${days}`, WATCHED);
  const value = history.value;
  const events = (value?.items ?? []).filter((event) => !hidden.includes(event.kind));
  const shown = all ? events : events.slice(0, FIRST);
  const toggle = (kind: Kind): void =>
    setHidden(hidden.includes(kind) ? hidden.filter((one) => one !== kind) : [...hidden, kind]);
  return (
    <div class={history.stale ? "stale" : ""}>
      {history.error !== null && <Notice kind="bad">{history.error}</Notice>}
      <Panel title="Time line">
        <Field label="Of the last">
          <select value={days} onChange={(event: SelectEvent) => setDays(Number(event.currentTarget.value))}>
            {SPANS.map(([length, words]) => (
              <option key={length} value={length}>
                {words}
              </option>
            ))}
          </select>
        </Field>
        {value === null && history.loading && <p role="status">Reading …</p>}
        {value !== null && !value.complete && (
          <Notice kind="warning">There is more in this time than is shown; what is missing is the oldest.</Notice>
        )}
        {value !== null && (
          <Timeline
            events={value.items}
            from={new Date(value.since).getTime()}
            to={new Date(value.since).getTime() + days * 86_400_000}
          />
        )}
      </Panel>
      {value !== null && (
        <Panel title={`What happened (${count(events.length)})`}>
          <fieldset class="kinds">
            <legend>Show</legend>
            {KINDS.map((kind) => (
              <label key={kind} class="check">
                <input type="checkbox" checked={!hidden.includes(kind)} onChange={() => toggle(kind)} />
                {LANES[kind]} ({count(value.items.filter((event) => event.kind === kind).length)})
              </label>
            ))}
          </fieldset>
          {events.length === 0 ? (
            <Empty>Nothing of this kind happened in this time.</Empty>
          ) : (
            <Table
              caption={`What happened to ${machine}, newest first`}
              columns={[
                { name: "time", title: "When" },
                { name: "what", title: "What" },
                { name: "until", title: "Until" },
                { name: "look", title: "" },
              ]}
              rows={shown.map((event, index) => ({
                key: `${event.time} ${event.kind} ${event.subject} ${index}`,
                time: time(event.time),
                what: <Mark kind={tone(event)}>{sentence(event)}</Mark>,
                until: event.severity == null ? "" : event.until == null ? "holds now" : time(event.until),
                look: (
                  <a class="row-link" href={href(event, machine)}>
                    View
                  </a>
                ),
              }))}
            />
          )}
          {shown.length < events.length && (
            <Button onClick={() => setAll(true)}>Show all {count(events.length)}</Button>
          )}
        </Panel>
      )}
    </div>
  );
}
