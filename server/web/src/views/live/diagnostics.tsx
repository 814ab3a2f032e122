/** How smoothly this device draws the plots; counted only while somebody looks. */
import { useEffect, useState } from "preact/hooks";
import { count, fixed, percent } from "../../ui/format";
import { FrameCounter, type Smoothness } from "./frames";
import { t } from "../../texts";

interface DiagnosticsProps {
  /** How often the plots were drawn since the page was opened. */
  draws: () => number;
  /** Rows that the service could not send in time, and that are read later. */
  missed: () => number;
}

export function Diagnostics(props: DiagnosticsProps) {
  const [open, setOpen] = useState(false);
  return (
    <details class="motion" onToggle={(event) => setOpen(event.currentTarget.open)}>
      <summary>{t("live.howSmoothlyDeviceDraws")}</summary>
      {open && <Counted {...props} />}
    </details>
  );
}

function Counted({ draws, missed }: DiagnosticsProps) {
  const [found, setFound] = useState<(Smoothness & { rate: number }) | null>(null);
  useEffect(() => {
    const counter = new FrameCounter();
    let frame = requestAnimationFrame(function step(now) {
      counter.frame(now);
      frame = requestAnimationFrame(step);
    });
    let [before, since] = [draws(), performance.now()];
    const timer = setInterval(() => {
      const now = performance.now();
      setFound({ ...counter.smoothness(now), rate: (1000 * (draws() - before)) / (now - since) });
      [before, since] = [draws(), now];
    }, 1000);
    return () => {
      cancelAnimationFrame(frame);
      clearInterval(timer);
    };
  }, []);
  if (found === null || found.seconds === 0) return <p class="hint">{t("live.counting")}</p>;
  const { frames, dropped, longest, rate, seconds } = found;
  return (
    <p class="hint" data-frames={frames} data-dropped={dropped} data-longest={longest} data-rate={rate}>
      {t("live.lastSDeviceShowed", {
        seconds: fixed(seconds, 0),
        frames: count(frames),
        dropped: count(dropped),
        dropped2: percent(dropped / Math.max(1, frames + dropped), 1),
        longest: fixed(longest, 0),
        rate: fixed(rate, 1),
        missed: count(missed()),
      })}
    </p>
  );
}
