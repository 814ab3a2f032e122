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
import { t } from "../../texts";
import { said } from "../../texts/report";

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
      <h1 class="title">{t("common.fleet")}</h1>
      {fleet.error !== null && <Notice kind="bad">{fleet.error}</Notice>}
      {fleet.value === null && fleet.loading && <p role="status">{t("common.reading")}</p>}
      {fleet.value !== null && (
        <Panel title={t("fleet.machines", { count: items.length })}>
          {items.length === 0 ? (
            <Empty>{t("common.thereNoMachineYet")}</Empty>
          ) : (
            <>
              <p class="hint">{t("fleet.nearestItsLimitFirst")}</p>
              <Table
                caption={t("common.allMachines")}
                columns={[
                  { name: "name", title: t("common.machine") },
                  { name: "state", title: t("common.state") },
                  { name: "residual", title: t("fleet.residualAgainstItsLimit") },
                  { name: "calibration", title: t("common.calibrationInUse") },
                  { name: "alarms", title: t("common.alarms") },
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
                    <Button
                      label={t("fleet.historyOf", { name: machine.name })}
                      onClick={() => show(machine.name, "#/history")}
                    >
                      {t("fleet.history")}
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
    return (
      <span class="hint reason">
        {machine.reason === null ? t("fleet.noJointWatchedYet") : said(machine.reason, machine.reason_message)}
      </span>
    );
  const tone = used >= 1 ? "bad" : used >= 0.5 ? "warning" : "good";
  const measured = joint.residual === null ? t("common.atRest") : `${number(joint.residual, 3)} ${joint.unit}`;
  return (
    <span class="stacked">
      <meter
        class={tone}
        min={0}
        max={1}
        value={Math.min(1, used)}
        aria-label={t("fleet.ofTheLimit", { used: percent(used) })}
      />
      <span>
        <strong>{percent(used)}</strong> {joint.joint}, {measured}
      </span>
    </span>
  );
}

function Calibration({ machine }: { machine: Machine }) {
  const one = machine.calibration;
  if (one === null) return <>{t("fleet.none")}</>;
  return (
    <span class="stacked">
      <span>{one.label || one.id}</span>
      <span class="hint">
        {t("fleet.sinceError", {
          activated: time(one.activated),
          error: one.error === null ? DASH : t("fleet.timesTheNoise", { error: number(one.error, 3) }),
        })}
      </span>
    </span>
  );
}

function Alarms({ machine }: { machine: Machine }) {
  const { critical, warning, info, waiting } = machine.alarms;
  if (critical + warning + info + waiting === 0) return <Mark kind="good">{t("fleet.none")}</Mark>;
  return (
    <a class="stacked row-link" href="#/alarms">
      {critical > 0 && <Mark kind="bad">{t("fleet.critical", { critical: count(critical) })}</Mark>}
      {warning > 0 && <Mark kind="warning">{t("fleet.warning", { count: warning })}</Mark>}
      {info > 0 && <Mark kind="info">{t("fleet.note", { count: info })}</Mark>}
      {critical + warning + info === 0 && <Mark kind="off">{t("fleet.noneHoldsNow")}</Mark>}
      {waiting > 0 && <span class="hint">{t("fleet.lookedAt", { waiting: count(waiting) })}</span>}
    </a>
  );
}
