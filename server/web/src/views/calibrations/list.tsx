/** Calibrations by what they are waiting for, what happened to them, and two to compare. */
import { useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { go } from "../../routes";
import { CommandNotice, useCommand } from "../../command";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Button, Field, Notice, type SelectEvent } from "../../ui/controls";
import { time } from "../../ui/format";
import { Confirm, Empty, Panel } from "../../ui/layout";
import { CalibrationCard } from "./card";
import { type Calibration, STATES, alike, before, history } from "./rules";
import { t } from "../../texts";

type List = components["schemas"]["CalibrationList"];

export function CalibrationList() {
  const session = useSession();
  const machine = session.machine.value;
  const path = machine === null ? null : `/calibrations?machine=${encodeURIComponent(machine)}&limit=200`;
  const list = useResource<List>(path, "calibrations");
  const items = list.value?.items ?? [];
  const inUse = items.filter((one) => one.state === "active");
  const active = inUse.find((one) => one.identification !== null);
  const valves = inUse.find((one) => one.identification === null);
  const waiting = items.filter((one) => one.state === "proposed" || one.state === "approved");
  const over = items.filter((one) => one.state === "rejected" || one.state === "retired");
  return (
    <div class={list.stale ? "stale" : ""}>
      <h1 class="title">
        {t("common.calibrations")} {machine !== null && <span class="hint">{machine}</span>}
      </h1>
      {list.error !== null && <Notice kind="bad">{list.error}</Notice>}
      {list.value === null && list.loading && <p role="status">{t("common.reading")}</p>}
      {machine !== null && list.value !== null && (
        <>
          <Panel title={t("calibrations.inUse")}>
            {active === undefined ? (
              <Empty>
                {t("calibrations.noCalibrationUseResult", {
                  approvesOwn: session.principal.value?.approves_own === true ? "" : t("calibrations.byAnotherPerson"),
                })}
              </Empty>
            ) : (
              <>
                <ul class="calibrations">
                  <CalibrationCard key={active.id} calibration={active} onDone={list.reload} />
                </ul>
                <RollBack machine={machine} active={active} items={items} onDone={list.reload} />
              </>
            )}
          </Panel>
          {valves !== undefined && (
            <Panel title={t("calibrations.valvesInUse")}>
              <ul class="calibrations">
                <CalibrationCard key={valves.id} calibration={valves} onDone={list.reload} />
              </ul>
              <RollBack machine={machine} active={valves} items={items} onDone={list.reload} />
            </Panel>
          )}
          {waiting.length > 0 && (
            <Cards title={t("calibrations.waiting", { count: waiting.length })} items={waiting} onDone={list.reload} />
          )}
          {over.length > 0 && (
            <Cards title={t("calibrations.earlierOnes", { count: over.length })} items={over} onDone={list.reload} />
          )}
          {items.length > 1 && <Choice items={items} />}
          {items.length > 0 && <History items={items} />}
        </>
      )}
    </div>
  );
}

function Cards({ title, items, onDone }: { title: string; items: Calibration[]; onDone: () => void }) {
  return (
    <Panel title={title}>
      <ul class="calibrations">
        {items.map((one) => (
          <CalibrationCard key={one.id} calibration={one} onDone={onDone} />
        ))}
      </ul>
    </Panel>
  );
}

interface RollBackProps {
  machine: string;
  active: Calibration;
  items: Calibration[];
  onDone: () => void;
}

function RollBack({ machine, active, items, onDone }: RollBackProps) {
  const to = before(items.filter((one) => alike(one, active)));
  const session = useSession();
  const command = useCommand();
  const [asking, setAsking] = useState(false);
  if (!session.may("engineer"))
    return (
      <p class="hint">
        {t("calibrations.anEngineerCan", {
          to: to === null ? t("calibrations.takeOutUse") : t("calibrations.rollBackCalibrationBefore"),
        })}
      </p>
    );
  const words = to === null ? t("calibrations.takeOutUse2") : t("calibrations.rollBack");
  const undo = (): void => {
    setAsking(false);
    if (to === null) {
      const path = `/calibrations/${encodeURIComponent(active.id)}/deactivate`;
      void command.run({ method: "POST", path, json: { note: "" } }, onDone);
      return;
    }
    const of = active.identification === null ? "?of=valves" : "";
    const path = `/machines/${encodeURIComponent(machine)}/calibrations/rollback${of}`;
    void command.run<Calibration>({ method: "POST", path }, (now) => {
      command.say({ kind: "good", text: t("calibrations.useAgain2", { label: now.label }) });
      onDone();
    });
  };
  return (
    <>
      <CommandNotice of={command} />
      <Button busy={command.busy} disabled={!session.online.value} onClick={() => setAsking(true)}>
        {words}
      </Button>
      {asking && (
        <Confirm
          title={`${words}?`}
          text={
            to === null ? (
              <p>{t("calibrations.firstOneMachineHas", { label: active.label })}</p>
            ) : (
              <p>{t("calibrations.takenOutUseCalibration", { label: active.label, label2: to.label })}</p>
            )
          }
          confirm={words}
          kind="danger"
          onNo={() => setAsking(false)}
          onYes={undo}
        />
      )}
    </>
  );
}

function Choice({ items }: { items: Calibration[] }) {
  const [chosen, setChosen] = useState<[string, string] | null>(null);
  const [a, b] = chosen ?? [items[1]?.id ?? "", items[0]?.id ?? ""];
  const select = (label: string, value: string, onChange: (id: string) => void) => (
    <Field label={label}>
      <select value={value} onChange={(event: SelectEvent) => onChange(event.currentTarget.value)}>
        {items.map((one) => (
          <option key={one.id} value={one.id}>
            {one.label}, {time(one.created)} ({STATES[one.state][1].toLowerCase()})
          </option>
        ))}
      </select>
    </Field>
  );
  return (
    <Panel title={t("calibrations.compareTwo")}>
      <div class="columns">
        {select(t("calibrations.thisOne"), a, (id) => setChosen([id, b]))}
        {select(t("calibrations.withThisOne"), b, (id) => setChosen([a, id]))}
      </div>
      <Button disabled={a === b} onClick={() => go(`#/calibrations/compare/${a}/${b}`)}>
        {t("calibrations.compare")}
      </Button>
    </Panel>
  );
}

function History({ items }: { items: Calibration[] }) {
  return (
    <Panel title={t("calibrations.history")}>
      <ol class="history">
        {history(items).map((step) => (
          <li key={`${step.time} ${step.text}`}>
            <span class="when">{time(step.time)}</span> <span>{step.text}</span>
          </li>
        ))}
      </ol>
    </Panel>
  );
}
