/**
 * What this device remembers; a browser that forbids storage forgets with the page.
 *
 * All pages of an origin share its storage: services behind one proxy are told apart by their paths.
 */
import { BASE } from "./place";

const own = (key: string): string => (BASE === "/" ? key : BASE + key);
const memory = new Map<string, string>();

export function remembered(key: string): string | null {
  try {
    return localStorage.getItem(own(key)) ?? memory.get(key) ?? null;
  } catch {
    return memory.get(key) ?? null;
  }
}

/** Keep `value`, or forget what was kept (null). */
export function remember(key: string, value: string | null): void {
  if (value === null) memory.delete(key);
  else memory.set(key, value);
  try {
    if (value === null) localStorage.removeItem(own(key));
    else localStorage.setItem(own(key), value);
  } catch {
    // The memory of the page has it.
  }
}
