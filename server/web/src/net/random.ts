/** A random name for an idempotency key. `crypto.randomUUID` is missing over plain http; `getRandomValues` is not. */
export function randomName(): string {
  const bytes = crypto.getRandomValues(new Uint8Array(16));
  return Array.from(bytes, (byte) => byte.toString(16).padStart(2, "0")).join("");
}
