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
import { t } from "../../texts";

type History = components["schemas"]["History"];

const SPANS: [number, string][] = [
  [7, t("history.oneWeek")],
  [30, t("history.30Days")],
  [90, t("history.90Days")],
  [365, t("history.oneYear")],
  [1826, t("history.fiveYears")],
];
const FIRST = 50;
const WATCHED = ["machines", "calibrations", "identifications", "alarms", "jobs"];

export default function HistoryView() {
  const session = useSession();
  const machine = session.machine.value;
  return (
    <>
      <h1 class="title">
        {t("history.history")} {machine !== null && <span class="hint">{machine}</span>}
      </h1>
      {machine === null ? (
        <Empty>{t("common.thereNoMachineYet")}</Empty>
      ) : (
        <MachineHistory key={machine} machine={machine} />
      )}
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
      <Panel title={t("history.timeLine")}>
        <Field label={t("history.ofTheLast")}>
          <select value={days} onChange={(event: SelectEvent) => setDays(Number(event.currentTarget.value))}>
            {SPANS.map(([length, words]) => (
              <option key={length} value={length}>
                {words}
              </option>
            ))}
          </select>
        </Field>
        {value === null && history.loading && <p role="status">{t("common.reading")}</p>}
        {value !== null && !value.complete && <Notice kind="warning">{t("history.thereMoreTimeThan")}</Notice>}
        {value !== null && (
          <Timeline
            events={value.items}
            from={new Date(value.since).getTime()}
            to={new Date(value.since).getTime() + days * 86_400_000}
          />
        )}
      </Panel>
      {value !== null && (
        <Panel title={t("history.whatHappened", { count: count(events.length) })}>
          <fieldset class="kinds">
            <legend>{t("history.show")}</legend>
            {KINDS.map((kind) => (
              <label key={kind} class="check">
                <input type="checkbox" checked={!hidden.includes(kind)} onChange={() => toggle(kind)} />
                {LANES[kind]} ({count(value.items.filter((event) => event.kind === kind).length)})
              </label>
            ))}
          </fieldset>
          {events.length === 0 ? (
            <Empty>{t("history.nothingKindHappenedTime")}</Empty>
          ) : (
            <Table
              caption={t("history.whatHappenedNewestFirst", { machine })}
              columns={[
                { name: "time", title: t("common.when") },
                { name: "what", title: t("history.what") },
                { name: "until", title: t("history.until") },
                { name: "look", title: "" },
              ]}
              rows={shown.map((event, index) => ({
                key: `${event.time} ${event.kind} ${event.subject} ${index}`,
                time: time(event.time),
                what: <Mark kind={tone(event)}>{sentence(event)}</Mark>,
                until: event.severity == null ? "" : event.until == null ? t("common.holdsNow") : time(event.until),
                look: (
                  <a class="row-link" href={href(event, machine)}>
                    {t("history.view")}
                  </a>
                ),
              }))}
            />
          )}
          {shown.length < events.length && (
            <Button onClick={() => setAll(true)}>{t("common.showAll", { count: count(events.length) })}</Button>
          )}
        </Panel>
      )}
    </div>
  );
}
