/** Which part of time is shown, by buttons that a gloved hand finds; what fingers and mouse do besides. */
import type { ComponentChildren } from "preact";
import { Button, type SelectEvent } from "../ui/controls";
import { type Range, SPANS, panned, type Shown, spanWords, zoomed } from "./range";

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
    <div class="chart-toolbar" role="toolbar" aria-label="What the plots show">
      <label class="window">
        <span class="for-reader">Window</span>
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
        <Button onClick={() => fixed(range())}>Pause</Button>
      ) : (
        <Button onClick={() => onShown({ kind: "live", span })}>▶ Live</Button>
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
      <Button label="Earlier" onClick={() => pan(-0.5)}>
        ←
      </Button>
      <Button label="Later" onClick={() => pan(0.5)}>
        →
      </Button>
      <Button label="Closer" onClick={() => zoom(0.5)}>
        +
      </Button>
      <Button label="Wider" onClick={() => zoom(2)}>
        −
      </Button>
    </>
  );
}
