/** Residual against the blamed variable, and friction curves. */
import { useMemo } from "preact/hooks";
import { number } from "../../ui/format";
import { Empty, Panel } from "../../ui/layout";
import { Plot } from "../../ui/plot";
import { cloud, friction } from "./drawn";
import { added } from "./model";
import type { FrictionCurve, Report, Scatter } from "./report";
import { unit, signalWords } from "./wording";
import { t } from "../../texts";

export function Residuals({ report }: { report: Report }) {
  return (
    <>
      {report.figures.scatter.map((scatter, at) => (
        <Residual key={at} scatter={scatter} report={report} />
      ))}
    </>
  );
}

function Residual({ scatter, report }: { scatter: Scatter; report: Report }) {
  const drawn = useMemo(() => cloud(scatter), [scatter]);
  const effort = unit(scatter.effort_unit || report.errors[scatter.joint]?.unit);
  const label = `${signalWords(scatter.variable)}${scatter.unit ? ` [${unit(scatter.unit)}]` : ""}`;
  const spread = (value: number): string => t("results.standardDeviation", { value: number(value, 3) });
  return (
    <Panel title={t("results.whatLeftAtAgainst", { joint: scatter.joint, variable: signalWords(scatter.variable) })}>
      <p class="hint">
        {t("results.eachPointMomentValidation", {
          partial: added(report)
            ? scatter.partial
              ? t("results.leftLawTakenOut")
              : t("results.otherParametersMovedToo")
            : "",
        })}
      </p>
      <div class="pair">
        <Plot
          title={`${scatter.partial ? t("results.withoutTheLaw") : t("results.before2")}: ${spread(drawn.spread.before)}`}
          unit={effort}
          x={{ label, values: drawn.before.x }}
          series={drawn.before.series}
          range={drawn.range}
          height={320}
        />
        {added(report) && (
          <Plot
            title={t("results.after", { after: spread(drawn.spread.after) })}
            unit={effort}
            x={{ label, values: drawn.after.x }}
            series={drawn.after.series}
            range={drawn.range}
            height={320}
          />
        )}
      </div>
    </Panel>
  );
}

export function Frictions({ report }: { report: Report }) {
  const curves = report.figures.friction;
  return (
    <Panel title={t("results.frictionEachJointOver")}>
      {curves.length === 0 ? (
        <Empty>{t("results.reportHasNoFriction")}</Empty>
      ) : (
        <>
          <p class="hint">{t("results.bandTwoStandardDeviations")}</p>
          <div class="curves">
            {curves.map((curve) => (
              <Friction key={curve.joint} curve={curve} />
            ))}
          </div>
        </>
      )}
    </Panel>
  );
}

function Friction({ curve }: { curve: FrictionCurve }) {
  const drawn = useMemo(() => friction(curve), [curve]);
  return (
    <Plot
      title={curve.joint}
      unit={unit(curve.unit_y)}
      x={{ label: t("results.speed", { unitX: unit(curve.unit_x) }), values: drawn.x }}
      series={drawn.series}
      height={230}
    />
  );
}
