/**
 * Hands on a drawing. Mouse: drag chooses a range, Shift and drag moves, Ctrl and wheel zooms, a double click goes back.
 * Touch: one finger moves, two zoom, a tap puts the cursor there.
 */
import type uPlot from "uplot";
import { type Range, within, zoomed } from "./range";

export interface Hands {
  /** The range that is shown now. */
  range(): Range;
  /** Show another. */
  show(range: Range): void;
  zoom(factor: number, centre: number): void;
  back(): void;
}

/** Hands that choose a range within `bounds`; null gives it back. */
export function rangeHands(now: Range, bounds: Range, choose: (range: Range | null) => void): Hands {
  const show = (next: Range): void => choose(within(next, bounds));
  return {
    range: () => now,
    show,
    zoom: (factor, centre) => show(zoomed(now, factor, centre, bounds)),
    back: () => choose(null),
  };
}

/** A finger that moved less than this (CSS pixels) has tapped. */
const TAP_PX = 8;

export function gestures(hands: Hands): uPlot.Plugin {
  return {
    hooks: {
      init: (plot) => {
        const over = plot.over;
        const fingers = new Map<number, number>();
        let began: { range: Range; x: number; spread: number; moved: boolean } | null = null;
        const place = (event: PointerEvent): number => event.clientX - over.getBoundingClientRect().left;
        const begin = (): void => {
          const places = [...fingers.values()];
          const x = places.reduce((sum, one) => sum + one, 0) / places.length;
          const spread = places.length > 1 ? Math.abs((places[0] as number) - (places[1] as number)) : 0;
          began = { range: hands.range(), x, spread, moved: began?.moved ?? false };
        };
        over.style.touchAction = "pan-y pinch-zoom";
        over.addEventListener("pointerdown", (event) => {
          if (event.pointerType === "mouse" && !event.shiftKey) return;
          if (fingers.size === 0) began = null;
          fingers.set(event.pointerId, place(event));
          over.setPointerCapture(event.pointerId);
          begin();
          if (event.pointerType === "mouse") event.preventDefault(); // else it would choose a range
        });
        over.addEventListener("pointermove", (event) => {
          if (!fingers.has(event.pointerId) || began === null) return;
          fingers.set(event.pointerId, place(event));
          const places = [...fingers.values()];
          const x = places.reduce((sum, one) => sum + one, 0) / places.length;
          if (!began.moved && places.length === 1 && Math.abs(x - began.x) < TAP_PX) return;
          began.moved = true;
          const [from, to] = began.range;
          const perPixel = (to - from) / Math.max(1, over.clientWidth);
          const spread = places.length > 1 ? Math.abs((places[0] as number) - (places[1] as number)) : 0;
          const factor = began.spread > 10 && spread > 10 ? began.spread / spread : 1;
          const centre = from + began.x * perPixel;
          const low = centre - x * perPixel * factor;
          hands.show([low, low + (to - from) * factor]);
        });
        const end = (event: PointerEvent): void => {
          if (!fingers.delete(event.pointerId)) return;
          if (fingers.size > 0) begin();
          else if (began !== null && !began.moved && event.type === "pointerup")
            plot.setCursor({ left: place(event), top: 1 }, true);
        };
        over.addEventListener("pointerup", end);
        over.addEventListener("pointercancel", end);
        over.addEventListener(
          "wheel",
          (event) => {
            if (!event.ctrlKey) return; // without it the page scrolls
            event.preventDefault();
            const centre = plot.posToVal(event.clientX - over.getBoundingClientRect().left, "x");
            hands.zoom(event.deltaY > 0 ? 1.25 : 0.8, centre);
          },
          { passive: false },
        );
        over.addEventListener("dblclick", () => hands.back());
      },
      setSelect: (plot) => {
        const { left, width } = plot.select;
        if (width < 4) return;
        hands.show([plot.posToVal(left, "x"), plot.posToVal(left + width, "x")]);
        plot.setSelect({ left: 0, top: 0, width: 0, height: 0 }, false);
      },
    },
  };
}
