/** Clock and timers as arguments, so that reconnecting can be tested without waiting. */
export interface Timers {
  now(): number;
  after(ms: number, work: () => void): () => void;
  random(): number;
}

export const realTimers: Timers = {
  now: () => Date.now(),
  after: (ms, work) => {
    const id = setTimeout(work, ms);
    return () => clearTimeout(id);
  },
  random: () => Math.random(),
};
