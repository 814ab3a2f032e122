/** Whether the arm, and its valves, still are as they were calibrated. */
import type { components } from "../../net/api.gen";
import { useRegularly, useResource } from "../../resource";
import { Mark, Notice, Progress } from "../../ui/controls";
import { number, percent, withStd } from "../../ui/format";
import { Panel, Table } from "../../ui/layout";
import { monitorWords } from "../../words";
import { LoadPanel } from "./load_panel";
import { t } from "../../texts";
import { said } from "../../texts/report";

type Monitor = components["schemas"]["MonitorResource"];
type Monitored = components["schemas"]["Monitored"];
type Moved = components["schemas"]["MovedNumber"];

/** ms between two looks: the monitor decides each two seconds of motion. */
const LOOK_MS = 2000;

export function MonitorPanel({ machine }: { machine: string }) {
  const path = `/machines/${encodeURIComponent(machine)}/monitor`;
  const monitor = useResource<Monitor>(path, ["calibrations", "machines"]);
  useRegularly(monitor, LOOK_MS);
  const value = monitor.value;
  const [kind, words] = value === null ? (["info", t("live.askingTheMonitor")] as const) : monitorWords(value.state);
  const valves = value?.valves;
  return (
    <>
      <LoadPanel monitor={value} />
      <Panel title={t("live.residualMonitor")} actions={<Mark kind={kind}>{words}</Mark>}>
        {monitor.error !== null && value === null && <Notice kind="bad">{monitor.error}</Notice>}
        {monitor.stale && <Notice kind="warning">{t("live.whatWasKnownLast")}</Notice>}
        {value !== null && <Followed of={value} caption={t("live.residualEachJoint")} />}
      </Panel>
      {valves !== undefined && valves.calibration !== null && (
        <Panel title={t("shell.valves")} actions={<ValvesMark of={valves} />}>
          <Followed of={valves} caption={t("live.speedEachAxis")} />
        </Panel>
      )}
    </>
  );
}

function ValvesMark({ of }: { of: Monitored }) {
  const [kind, words] = monitorWords(of.state);
  return <Mark kind={kind}>{of.state === "drift" ? t("live.valvesChanged") : words}</Mark>;
}

function Followed({ of, caption }: { of: Monitored; caption: string }) {
  const learnt = of.joints.length === 0 ? 0 : Math.min(...of.joints.map((joint) => joint.learnt));
  const moved = of.joints.some((joint) => joint.moved.length > 0);
  return (
    <>
      {of.state === "off" && (
        <p class="hint">{of.reason ? said(of.reason, of.reason_message) : t("live.needsActiveCalibrationMachine")}</p>
      )}
      {of.state === "learning" && (
        <p class="hint">{t("live.learnsOnlyWhileArm", { none: learnt === 0 ? t("live.hasNoDataYet") : "" })}</p>
      )}
      {of.state === "learning" && learnt > 0 && <Progress fraction={learnt} text={t("live.motionLearnsFrom")} />}
      {of.joints.length > 0 && (
        <Table
          caption={caption}
          columns={[
            { name: "joint", title: t("common.joint") },
            { name: "residual", title: t("live.residual"), align: "right" },
            { name: "drift", title: t("live.shareAlarmThreshold"), align: "right" },
            ...(moved ? [{ name: "moved", title: t("live.moved") }] : []),
          ]}
          rows={of.joints.map((joint) => ({
            key: joint.joint,
            joint: joint.joint,
            residual: joint.residual === null ? t("common.atRest") : `${number(joint.residual, 3)} ${joint.unit}`,
            drift: percent(joint.threshold > 0 ? joint.cusum / joint.threshold : null),
            moved: joint.moved.map(movedWords).join("; "),
          }))}
        />
      )}
    </>
  );
}

const WAYS: Record<string, string> = { extend: t("valves.extend"), retract: t("valves.retract") };
const NUMBERS: Record<string, string> = { edge: t("live.edge"), gain: t("live.gain"), delay: t("live.delay") };

/** One number of a valve, and by how much it has moved. */
function movedWords({ name, value, std, unit }: Moved): string {
  const [what = "", way = ""] = name.split(".");
  return t("live.movedBy", {
    what: NUMBERS[what] ?? what,
    way: WAYS[way] ?? way,
    by: withStd(value, std),
    unit: said(unit),
  });
}
