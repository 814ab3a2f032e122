/** Whether the arm still is as it was calibrated. */
import type { components } from "../../net/api.gen";
import { useRegularly, useResource } from "../../resource";
import { Mark, Notice, Progress } from "../../ui/controls";
import { number, percent } from "../../ui/format";
import { Panel, Table } from "../../ui/layout";
import { monitorWords } from "../../words";
import { LoadPanel } from "./load_panel";
import { t } from "../../texts";
import { said } from "../../texts/report";

type Monitor = components["schemas"]["MonitorResource"];

/** ms between two looks: the monitor decides each two seconds of motion. */
const LOOK_MS = 2000;

export function MonitorPanel({ machine }: { machine: string }) {
  const path = `/machines/${encodeURIComponent(machine)}/monitor`;
  const monitor = useResource<Monitor>(path, ["calibrations", "machines"]);
  useRegularly(monitor, LOOK_MS);
  const value = monitor.value;
  const [kind, words] = value === null ? (["info", t("live.askingTheMonitor")] as const) : monitorWords(value.state);
  const joints = value?.joints ?? [];
  const learnt = joints.length === 0 ? 0 : Math.min(...joints.map((joint) => joint.learnt));
  return (
    <>
      <LoadPanel monitor={value} />
      <Panel title={t("live.residualMonitor")} actions={<Mark kind={kind}>{words}</Mark>}>
        {monitor.error !== null && value === null && <Notice kind="bad">{monitor.error}</Notice>}
        {monitor.stale && <Notice kind="warning">{t("live.whatWasKnownLast")}</Notice>}
        {value?.state === "off" && (
          <p class="hint">{value.reason ? said(value.reason) : t("live.needsActiveCalibrationMachine")}</p>
        )}
        {value?.state === "learning" && (
          <p class="hint">{t("live.learnsOnlyWhileArm", { none: learnt === 0 ? t("live.hasNoDataYet") : "" })}</p>
        )}
        {value?.state === "learning" && learnt > 0 && <Progress fraction={learnt} text={t("live.motionLearnsFrom")} />}
        {value !== null && value.joints.length > 0 && (
          <Table
            caption={t("live.residualEachJoint")}
            columns={[
              { name: "joint", title: t("common.joint") },
              { name: "residual", title: t("live.residual"), align: "right" },
              { name: "drift", title: t("live.shareAlarmThreshold"), align: "right" },
            ]}
            rows={value.joints.map((joint) => ({
              key: joint.joint,
              joint: joint.joint,
              residual: joint.residual === null ? t("common.atRest") : `${number(joint.residual, 3)} ${joint.unit}`,
              drift: percent(joint.threshold > 0 ? joint.cusum / joint.threshold : null),
            }))}
          />
        )}
      </Panel>
    </>
  );
}
