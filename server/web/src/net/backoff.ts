/** Pauses between attempts: doubled each time, never longer than the last, spread so that tablets do not come at once. */
export function pause(attempt: number, random: () => number, firstMs = 500, longestMs = 8000): number {
  const whole = Math.min(longestMs, firstMs * 2 ** Math.min(attempt, 16));
  return whole * (0.5 + 0.5 * random());
}
