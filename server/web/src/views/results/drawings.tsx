/** Residual against the blamed variable, and friction curves. */
import { useMemo } from "preact/hooks";
import { number } from "../../ui/format";
import { Empty, Panel } from "../../ui/layout";
import { Plot } from "../../ui/plot";
import { cloud, friction } from "./drawn";
import { added } from "./model";
import type { FrictionCurve, Report, Scatter } from "./report";
import { unit, words } from "./wording";

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
  const label = `${words(scatter.variable)}${scatter.unit ? ` [${unit(scatter.unit)}]` : ""}`;
  const spread = (value: number): string => `standard deviation ${number(value, 3)}`;
  return (
    <Panel title={`What is left at ${scatter.joint}, against ${words(scatter.variable)}`}>
      <p class="hint">
        Each point is a moment of the validation motion: measured minus predicted. A model that lacks nothing leaves a
        cloud around zero without a shape.
        {added(report) &&
          (scatter.partial
            ? " On the left the law is taken out of the final model and everything else stays: the points lie on what it explains."
            : " Other parameters moved too when the law was fitted: the points before lie beside it where those had taken its place.")}
      </p>
      <div class="pair">
        <Plot
          title={`${scatter.partial ? "Without the law" : "Before"}: ${spread(drawn.spread.before)}`}
          unit={effort}
          x={{ label, values: drawn.before.x }}
          series={drawn.before.series}
          range={drawn.range}
          height={320}
        />
        {added(report) && (
          <Plot
            title={`After: ${spread(drawn.spread.after)}`}
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
    <Panel title="Friction of each joint over its speed">
      {curves.length === 0 ? (
        <Empty>This report has no friction curves; it was made by an earlier version.</Empty>
      ) : (
        <>
          <p class="hint">The band is two standard deviations. Where it is wide, few moments were recorded.</p>
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
      x={{ label: `speed [${unit(curve.unit_x)}]`, values: drawn.x }}
      series={drawn.series}
      height={230}
    />
  );
}
