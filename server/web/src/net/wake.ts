/** Tells when the page woke: a clock that jumped, a page that is shown again, a network that came back. */
export const TICK_MS = 1000;
/** Milliseconds between two ticks that sleep (or a frozen tab) explains, and a busy device hardly. */
export const ASLEEP_MS = 8000;

export class SleepWatch {
  private last: number;

  constructor(now: number) {
    this.last = now;
  }

  /** Milliseconds that were slept through before this tick; 0 when awake. */
  tick(now: number): number {
    const gap = now - this.last;
    this.last = now;
    return gap > ASLEEP_MS ? gap : 0;
  }
}

/** Call `woke` whenever connections cannot be trusted any more. */
export function watchWaking(woke: (reason: string) => void): void {
  const watch = new SleepWatch(Date.now());
  setInterval(() => {
    const gap = watch.tick(Date.now());
    if (gap > 0) woke(`this device slept for ${Math.round(gap / 1000)} s`);
  }, TICK_MS);
  let hidden: number | null = document.hidden ? Date.now() : null;
  document.addEventListener("visibilitychange", () => {
    if (document.hidden) hidden = Date.now();
    else if (hidden !== null) {
      const gap = Date.now() - hidden;
      hidden = null;
      // A hidden page's timers rest; whether its sockets live is anybody's guess.
      if (gap > ASLEEP_MS) {
        watch.tick(Date.now());
        woke(`this page was hidden for ${Math.round(gap / 1000)} s`);
      }
    }
  });
  window.addEventListener("pageshow", (event) => {
    if (event.persisted) woke("this page came back from the browser's cache");
  });
  window.addEventListener("online", () => woke("the network came back"));
}
