/** Which part of time is shown, by buttons that a gloved hand finds; what fingers and mouse do besides. */
import type { ComponentChildren } from "preact";
import { Button, type SelectEvent } from "../ui/controls";
import { type Range, SPANS, panned, type Shown, spanWords, zoomed } from "./range";
import { t } from "../texts";

interface ToolbarProps {
  shown: Shown;
  range: () => Range;
  bounds: () => Range;
  onShown: (shown: Shown) => void;
  /** The last live window, which "Live" goes back to. */
  span: number;
  children?: ComponentChildren;
}

export function LiveToolbar({ shown, range, bounds, onShown, span, children }: ToolbarProps) {
  const live = shown.kind === "live";
  const fixed = ([from, to]: Range): void => onShown({ kind: "fixed", from, to });
  return (
    <div class="chart-toolbar" role="toolbar" aria-label={t("common.whatPlotsShow")}>
      <label class="window">
        <span class="for-reader">{t("charts.window")}</span>
        <select
          value={span}
          onChange={(event: SelectEvent) => onShown({ kind: "live", span: Number(event.currentTarget.value) })}
        >
          {SPANS.map((seconds) => (
            <option key={seconds} value={seconds}>
              {spanWords(seconds)}
            </option>
          ))}
        </select>
      </label>
      {live ? (
        <Button onClick={() => fixed(range())}>{t("common.pause")}</Button>
      ) : (
        <Button onClick={() => onShown({ kind: "live", span })}>{t("charts.live")}</Button>
      )}
      <RangeButtons range={range} bounds={bounds} onRange={fixed} />
      {children}
    </div>
  );
}

/** Earlier, later, closer, wider. */
export function RangeButtons({
  range,
  bounds,
  onRange,
}: {
  range: () => Range;
  bounds: () => Range;
  onRange: (range: Range) => void;
}) {
  const pan = (share: number): void => {
    const [from, to] = range();
    onRange(panned([from, to], share * (to - from), bounds()));
  };
  const zoom = (factor: number): void => {
    const [from, to] = range();
    onRange(zoomed([from, to], factor, (from + to) / 2, bounds()));
  };
  return (
    <>
      <Button label={t("charts.earlier")} onClick={() => pan(-0.5)}>
        ←
      </Button>
      <Button label={t("charts.later")} onClick={() => pan(0.5)}>
        →
      </Button>
      <Button label={t("charts.closer")} onClick={() => zoom(0.5)}>
        +
      </Button>
      <Button label={t("charts.wider")} onClick={() => zoom(2)}>
        −
      </Button>
    </>
  );
}
