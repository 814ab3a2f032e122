/** Which page is shown: the part of the address behind `#/`. */
import { signal } from "@preact/signals";

export interface Route {
  path: string[];
  query: Record<string, string>;
}

export const FIRST = "#/live";

/** The route of an address's hash; anything that is no route leads to the first page. */
export function parseRoute(hash: string): Route {
  const text = hash.startsWith("#/") ? hash.slice(2) : FIRST.slice(2);
  const [path = "", query = ""] = text.split("?", 2);
  return {
    path: path.split("/").filter(Boolean).map(decode),
    query: Object.fromEntries(new URLSearchParams(query)),
  };
}

/** The code in the address that a QR code opened (`#pair=123456`), or null. */
export function pairingCode(hash: string): string | null {
  return /^#pair=([0-9]{10})(?:&sha256=[0-9a-f]{64})?$/.exec(hash)?.[1] ?? null;
}

/** SHA-256 of the certificate that the code came with, in pairs as browsers show it; null if it came with none. */
export function pairingFingerprint(hash: string): string | null {
  const found = /^#pair=[0-9]{10}&sha256=([0-9a-f]{64})$/.exec(hash)?.[1];
  return found === undefined ? null : (found.match(/../g) as string[]).join(":").toUpperCase();
}

function decode(part: string): string {
  try {
    return decodeURIComponent(part);
  } catch {
    return part;
  }
}

const current = signal<Route>(parseRoute(location.hash));
const changed = () => (current.value = parseRoute(location.hash));
window.addEventListener("hashchange", changed);

/** The route now; whoever calls it is drawn again when it changes. */
export function useRoute(): Route {
  return current.value;
}

/** Go to `#/...`. */
export function go(hash: string): void {
  location.hash = hash;
  changed();
}
