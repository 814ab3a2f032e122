/** How smoothly this device draws: the frames of its screen that came, and those that did not. */

/** ms between two frames of a screen that shows sixty a second; a faster one has its own. */
const SIXTY_MS = 1000 / 60;
/** ms that are looked back. */
export const WINDOW_MS = 10_000;

export interface Smoothness {
  /** s that are counted. */
  seconds: number;
  frames: number;
  dropped: number;
  /** ms, the longest time between two frames. */
  longest: number;
}

/** Counts frames by the times at which they came. */
export class FrameCounter {
  private times: number[] = [];

  /** A frame came at `now` (ms). */
  frame(now: number): void {
    this.times.push(now);
    if (now - (this.times[0] as number) > 2 * WINDOW_MS)
      this.times = this.times.filter((time) => now - time <= WINDOW_MS);
  }

  /** The last ten seconds before `now`. A frame is dropped where the next one came a whole frame later than it could. */
  smoothness(now: number): Smoothness {
    const recent = this.times.filter((time) => now - time <= WINDOW_MS);
    const gaps = recent.slice(1).map((time, index) => time - (recent[index] as number));
    const sorted = [...gaps].sort((a, b) => a - b);
    const usual = Math.min(SIXTY_MS, sorted[Math.floor(sorted.length / 2)] ?? SIXTY_MS);
    const dropped = gaps.reduce((sum, gap) => sum + Math.max(0, Math.round(gap / Math.max(4, usual)) - 1), 0);
    const seconds = recent.length < 2 ? 0 : ((recent[recent.length - 1] as number) - (recent[0] as number)) / 1000;
    return { seconds, frames: gaps.length, dropped, longest: sorted[sorted.length - 1] ?? 0 };
  }
}
