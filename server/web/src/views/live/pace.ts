/** Draws as often as the device can: what comes meanwhile waits for the next time. */

/** Shortest time between two drawings, ms; numbers that change more than about three times a second cannot be read. */
export const SHORTEST_MS = 300;
/** Drawing takes at most this part of the device's time. */
const SHARE = 0.3;

export interface Clock {
  now(): number;
  after(ms: number, work: () => void): void;
  /** Calls `work` when what was asked for has been drawn. */
  drawn(work: () => void): void;
}

export const realClock: Clock = {
  now: () => performance.now(),
  after: (ms, work) => void setTimeout(work, ms),
  drawn: (work) => void requestAnimationFrame(() => setTimeout(work)),
};

/**
 * A function to call whenever there is something new; it calls `draw`, never twice at once and not too often.
 *
 * `shortest`: ms between two drawings; less than for numbers where something moves.
 */
export function paced(draw: () => void, clock: Clock = realClock, shortest = SHORTEST_MS): () => void {
  let waiting = false;
  let next = 0;
  return () => {
    if (waiting) return;
    waiting = true;
    clock.after(Math.max(0, next - clock.now()), () => {
      const start = clock.now();
      draw();
      clock.drawn(() => {
        const took = clock.now() - start;
        next = start + Math.max(shortest, took / SHARE);
        waiting = false;
      });
    });
  };
}

/** Draws a part; false where there was nothing to draw. */
export type Part = () => unknown;

/** ms in which a frame that is not late has been shown. */
const FRAME_MS = 1000 / 60;
/** ms after which even a device that is busy with something else draws again. */
const LONGEST_PAUSE_MS = 500;

/**
 * As `paced`, for a drawing of several parts (each plot, and the numbers below it): one in each frame, so that none of these is dropped. To bring a part on the
 * screen takes longer than to draw it, and is seen only in how late the next frame is. All parts are drawn before any is
 * drawn again. `shortest`: ms between two drawings of the same part.
 */
export function sliced(
  parts: () => Part[],
  clock: Clock = realClock,
  shortest: () => number = () => SHORTEST_MS,
): () => void {
  let waiting = false;
  let next = 0;
  return () => {
    if (waiting) return;
    waiting = true;
    clock.after(Math.max(0, next - clock.now()), () => {
      const start = clock.now();
      const todo = parts();
      let worked = 0;
      const slice = (): void => {
        const begun = clock.now();
        while (todo.length > 0 && todo.shift()?.() === false);
        const drew = clock.now() - begun;
        clock.drawn(() => {
          worked += Math.max(drew, clock.now() - begun - FRAME_MS);
          if (todo.length > 0) return slice();
          next = Math.min(start + Math.max(shortest(), worked / SHARE), clock.now() + LONGEST_PAUSE_MS);
          waiting = false;
        });
      };
      slice();
    });
  };
}
