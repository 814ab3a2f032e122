/** One axis: its edges and delay in words, the curve, what was predicted of another motion, what its model lacked. */
import { useMemo } from "preact/hooks";
import { Notice } from "../../ui/controls";
import { DASH, number, percent, share, withStd } from "../../ui/format";
import { Panel, Table } from "../../ui/layout";
import { Plot } from "../../ui/plot";
import { compensation, curve } from "./drawn";
import { type Axis, type Effect, WAYS, type Way } from "./report";
import { t } from "../../texts";
import { said } from "../../texts/report";

const WAY_WORDS: Record<Way, string> = { extend: t("valves.extend"), retract: t("valves.retract") };
const REASONS: Record<string, string> = {
  before: t("valves.handedOutBefore"),
  static: t("valves.handedOutStatic"),
};

export function AxisPanel({ joint, axis }: { joint: string; axis: Axis }) {
  const judged = axis.errors.role === "validate";
  return (
    <Panel title={t("valves.axis", { joint })}>
      <ul class="plain-list">
        {WAYS.map((way) => (
          <li key={way}>{edge(axis, way)}</li>
        ))}
        {WAYS.map((way) => {
          const words = controller(axis, way);
          return words === null ? null : (
            <li key={`controller-${way}`}>
              <strong>{words}</strong>
            </li>
          );
        })}
        <li>{t("valves.delayIs", { delay: withStd(axis.delay.value, axis.delay.std) })}</li>
        {axis.pump_limit !== null && <li>{t("valves.pumpGives", { flow: number(axis.pump_limit.value * 6e4, 3) })}</li>}
        <li>
          {judged
            ? t("valves.errorOnUnseen", { error: share(axis.errors.handed_out) })
            : t("valves.errorOnFitted", { error: share(axis.errors.handed_out) })}
        </li>
        {REASONS[axis.handed_out] !== undefined && <li>{REASONS[axis.handed_out]}</li>}
      </ul>
      {axis.checks.map((check) => (
        <Notice key={check.code + check.text} kind="warning">
          {said(check.text)}: {said(check.cure)}
        </Notice>
      ))}
      <Curves joint={joint} axis={axis} judged={judged} />
      <Effects joint={joint} effects={[...axis.effects, ...(axis.unexplained ?? [])]} />
      <details>
        <summary>{t("valves.delayAndPeers")}</summary>
        <Plot
          title={t("valves.profile")}
          unit="%"
          x={{ label: t("valves.delayAxis"), values: axis.delay.profile.map(([delay]) => delay) }}
          series={[{ label: t("valves.misfit"), values: axis.delay.profile.map(([, misfit]) => 100 * misfit) }]}
          height={200}
        />
        <Peers joint={joint} axis={axis} />
      </details>
    </Panel>
  );
}

function edge(axis: Axis, way: Way): string {
  const { edge_at_2_percent: found, law, speed_at_largest: fastest } = axis.directions[way];
  if (found === undefined || fastest === undefined) return t("valves.neverMoved", { way: WAY_WORDS[way] });
  return t("valves.edgeIs", {
    way: WAY_WORDS[way],
    edge: withStd(found.value, found.std),
    command: number(found.command, 4),
    unit: found.command_unit === "1" ? "" : ` ${found.command_unit}`,
    speed: number(fastest.value, 3),
    law: said(law?.title ?? ""),
  });
}

/** The sentence on the dead band that the controller compensates. */
function controller(axis: Axis, way: Way): string | null {
  const direction = axis.directions[way];
  const verdict = compensation(direction);
  if (verdict === null || !direction.compensated) return null;
  const values = {
    way: WAY_WORDS[way],
    value: number(direction.compensated.value, 3),
    by: number(Math.abs(direction.compensated.too_small_by.value), 2),
  };
  if (verdict === "right") return t("valves.compensatedRight", { way: values.way, value: values.value });
  return verdict === "small" ? t("valves.compensatedSmall", values) : t("valves.compensatedLarge", values);
}

function Curves({ joint, axis, judged }: { joint: string; axis: Axis; judged: boolean }) {
  const drawn = useMemo(() => curve(axis), [axis]);
  const courses = useMemo(
    () => [
      { label: t("valves.measured"), values: axis.figures.measured },
      { label: t("valves.predicted"), values: axis.figures.predicted },
    ],
    [axis],
  );
  return (
    <div class="valve-plots">
      <Plot
        title={t("valves.speedOverCommand", { joint })}
        unit="m/s"
        x={{ label: t("valves.commandAxis"), values: drawn.x }}
        series={drawn.series}
      />
      <Plot
        title={judged ? t("valves.onUnseenMotion", { joint }) : t("valves.onFittedMotion", { joint })}
        unit="m/s"
        x={{ label: t("valves.timeAxis"), values: axis.figures.time }}
        series={courses}
      />
    </div>
  );
}

function Effects({ joint, effects }: { joint: string; effects: Effect[] }) {
  if (effects.length === 0) return <p class="hint">{t("valves.nothingMissing")}</p>;
  return (
    <>
      <Table
        caption={t("valves.lackedBy", { joint })}
        columns={[
          { name: "title", title: t("valves.lacked") },
          { name: "probability", title: t("valves.probability"), align: "right" },
          { name: "error", title: t("valves.leftOutError"), align: "right" },
          { name: "look", title: t("valves.lookAt") },
        ]}
        rows={effects.map((one) => ({
          key: one.id,
          title: said(one.title),
          probability: percent(one.probability),
          error: `${share(one.error_before)} → ${share(one.error_after)}`,
          look: one.look_at === undefined ? DASH : said(one.look_at),
        }))}
      />
      {effects
        .filter((one) => one.indistinguishable_from.length > 0)
        .map((one) => (
          <p key={one.id}>
            {t("valves.alike", { title: said(one.title), others: one.indistinguishable_from.join(", ") })}{" "}
            {one.experiment !== undefined && said(one.experiment)}
          </p>
        ))}
    </>
  );
}

function Peers({ joint, axis }: { joint: string; axis: Axis }) {
  const { errors } = axis;
  const rows: [string, number | null][] = [
    [t("valves.before"), errors.before],
    [t("valves.after"), errors.after],
    [t("valves.handedOut"), errors.handed_out],
    [t("valves.static"), errors.static],
    ["ARX(2,2)", errors.arx],
    [t("valves.linear"), errors.linear],
  ];
  return (
    <Table
      caption={t("valves.peersOf", { joint })}
      columns={[
        { name: "model", title: t("valves.model") },
        { name: "error", title: t("valves.errorOfSpeed"), align: "right" },
      ]}
      rows={rows.map(([model, error]) => ({ key: model, model, error: share(error) }))}
    />
  );
}
