/** Draws as often as the device can: what comes meanwhile waits for the next time. */

/** Shortest time between two drawings, ms; numbers that change faster cannot be read. */
export const SHORTEST_MS = 150;
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

/** ms of a frame that drawings may take before the rest waits for the next one: a frame has 16. */
const SLICE_MS = 6;

/**
 * As `paced`, for a drawing of several parts: as many in one frame as take six ms, at least one, the others in the frames
 * that follow, so that none of these is dropped. All of them are drawn before any is drawn again.
 */
export function sliced(parts: () => (() => void)[], clock: Clock = realClock, shortest = SHORTEST_MS): () => void {
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
        do todo.shift()?.();
        while (todo.length > 0 && clock.now() - begun < SLICE_MS);
        worked += clock.now() - begun;
        clock.drawn(() => {
          if (todo.length > 0) return slice();
          next = Math.max(start + shortest, clock.now() + worked / SHARE - (clock.now() - start));
          waiting = false;
        });
      };
      slice();
    });
  };
}
