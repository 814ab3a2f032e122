/** Whether the arm still is as it was calibrated. */
import type { components } from "../../net/api.gen";
import { useRegularly, useResource } from "../../resource";
import { Mark, Notice, Progress } from "../../ui/controls";
import { number, percent } from "../../ui/format";
import { Panel, Table } from "../../ui/layout";
import { monitorWords } from "../../words";
import { LoadPanel } from "./load_panel";

type Monitor = components["schemas"]["MonitorResource"];

/** ms between two looks: the monitor decides each two seconds of motion. */
const LOOK_MS = 2000;

export function MonitorPanel({ machine }: { machine: string }) {
  const path = `/machines/${encodeURIComponent(machine)}/monitor`;
  const monitor = useResource<Monitor>(path, ["calibrations", "machines"]);
  useRegularly(monitor, LOOK_MS);
  const value = monitor.value;
  const [kind, words] = value === null ? (["info", "Asking the monitor"] as const) : monitorWords(value.state);
  const joints = value?.joints ?? [];
  const learnt = joints.length === 0 ? 0 : Math.min(...joints.map((joint) => joint.learnt));
  return (
    <>
      <LoadPanel monitor={value} />
      <Panel title="Residual monitor" actions={<Mark kind={kind}>{words}</Mark>}>
        {monitor.error !== null && value === null && <Notice kind="bad">{monitor.error}</Notice>}
        {monitor.stale && <Notice kind="warning">This is what was known last.</Notice>}
        {value?.state === "off" && (
          <p class="hint">{value.reason ?? "It needs an active calibration and a machine that is acquired."}</p>
        )}
        {value?.state === "learning" && (
          <p class="hint">
            It learns only while the arm moves.{learnt === 0 && " It has no data yet: a joint has not moved so far."}
          </p>
        )}
        {value?.state === "learning" && learnt > 0 && (
          <Progress fraction={learnt} text="of the motion that it learns from" />
        )}
        {value !== null && value.joints.length > 0 && (
          <Table
            caption="Residual of each joint"
            columns={[
              { name: "joint", title: "Joint" },
              { name: "residual", title: "Residual", align: "right" },
              { name: "drift", title: "Share of alarm threshold", align: "right" },
            ]}
            rows={value.joints.map((joint) => ({
              key: joint.joint,
              joint: joint.joint,
              residual: joint.residual === null ? "at rest" : `${number(joint.residual, 3)} ${joint.unit}`,
              drift: percent(joint.threshold > 0 ? joint.cusum / joint.threshold : null),
            }))}
          />
        )}
      </Panel>
    </>
  );
}
