/** All machines at a glance, the one nearest to its limit first. */
import type { components } from "../../net/api.gen";
import { go } from "../../routes";
import { useRegularly, useResource } from "../../resource";
import { useSession } from "../../session";
import { Button, Mark, Notice } from "../../ui/controls";
import { count, DASH, number, percent, time } from "../../ui/format";
import { Empty, Panel, Table } from "../../ui/layout";
import { acquisitionWords, monitorWords } from "../../words";
import "./fleet.css";

type Fleet = components["schemas"]["Fleet"];
type Machine = components["schemas"]["FleetMachine"];

/** ms between two looks: the monitor decides each two seconds of motion, and says so to nobody. */
const LOOK_MS = 5000;

export default function FleetView() {
  const session = useSession();
  const fleet = useResource<Fleet>("/fleet", ["machines", "calibrations", "alarms", "acquisition"]);
  useRegularly(fleet, LOOK_MS);
  const items = fleet.value?.items ?? [];
  const show = (machine: string, hash: string): void => {
    session.choose(machine);
    go(hash);
  };
  return (
    <div class={fleet.stale ? "stale" : ""}>
      <h1 class="title">Fleet</h1>
      {fleet.error !== null && <Notice kind="bad">{fleet.error}</Notice>}
      {fleet.value === null && fleet.loading && <p role="status">Reading …</p>}
      {fleet.value !== null && (
        <Panel title={items.length === 1 ? "One machine" : `${count(items.length)} machines`}>
          {items.length === 0 ? (
            <Empty>There is no machine yet.</Empty>
          ) : (
            <>
              <p class="hint">
                Nearest to its limit first. At 100 % a drift is reported; a machine at rest keeps its last share.
              </p>
              <Table
                caption="All machines"
                columns={[
                  { name: "name", title: "Machine" },
                  { name: "state", title: "State" },
                  { name: "residual", title: "Residual against its limit" },
                  { name: "calibration", title: "Calibration in use" },
                  { name: "alarms", title: "Alarms" },
                  { name: "look", title: "" },
                ]}
                rows={items.map((machine) => ({
                  key: machine.name,
                  name: (
                    <a
                      class="row-link"
                      href="#/live"
                      onClick={(event) => (event.preventDefault(), show(machine.name, "#/live"))}
                    >
                      {machine.name}
                    </a>
                  ),
                  state: <State machine={machine} />,
                  residual: <Residual machine={machine} />,
                  calibration: <Calibration machine={machine} />,
                  alarms: <Alarms machine={machine} />,
                  look: (
                    <Button label={`History of ${machine.name}`} onClick={() => show(machine.name, "#/history")}>
                      History
                    </Button>
                  ),
                }))}
              />
            </>
          )}
        </Panel>
      )}
    </div>
  );
}

function State({ machine }: { machine: Machine }) {
  const [kind, words] = acquisitionWords(machine.acquisition);
  const [watch, said] = monitorWords(machine.monitor);
  return (
    <span class="stacked">
      <Mark kind={kind}>{words}</Mark>
      <Mark kind={watch}>{said}</Mark>
    </span>
  );
}

/** How much of the alarm threshold the worst joint has used up: 0 is none, 1 a drift. */
export function share(machine: Machine): number | null {
  const joint = machine.joint;
  return joint === null || joint.threshold <= 0 ? null : joint.cusum / joint.threshold;
}

function Residual({ machine }: { machine: Machine }) {
  const used = share(machine);
  const joint = machine.joint;
  if (used === null || joint === null)
    return <span class="hint reason">{machine.reason ?? "No joint is watched yet."}</span>;
  const tone = used >= 1 ? "bad" : used >= 0.5 ? "warning" : "good";
  const measured = joint.residual === null ? "at rest" : `${number(joint.residual, 3)} ${joint.unit}`;
  return (
    <span class="stacked">
      <meter class={tone} min={0} max={1} value={Math.min(1, used)} aria-label={`${percent(used)} of the limit`} />
      <span>
        <strong>{percent(used)}</strong> {joint.joint}, {measured}
      </span>
    </span>
  );
}

function Calibration({ machine }: { machine: Machine }) {
  const one = machine.calibration;
  if (one === null) return <>none</>;
  return (
    <span class="stacked">
      <span>{one.label || one.id}</span>
      <span class="hint">
        since {time(one.activated)}; error {one.error === null ? DASH : `${number(one.error, 3)} times the noise`}
      </span>
    </span>
  );
}

function Alarms({ machine }: { machine: Machine }) {
  const { critical, warning, info, waiting } = machine.alarms;
  if (critical + warning + info + waiting === 0) return <Mark kind="good">none</Mark>;
  return (
    <a class="stacked row-link" href="#/alarms">
      {critical > 0 && <Mark kind="bad">{count(critical)} critical</Mark>}
      {warning > 0 && (
        <Mark kind="warning">
          {count(warning)} warning{warning === 1 ? "" : "s"}
        </Mark>
      )}
      {info > 0 && (
        <Mark kind="info">
          {count(info)} note{info === 1 ? "" : "s"}
        </Mark>
      )}
      {critical + warning + info === 0 && <Mark kind="off">none holds now</Mark>}
      {waiting > 0 && <span class="hint">{count(waiting)} to be looked at</span>}
    </a>
  );
}
