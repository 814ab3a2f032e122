/** What was typed and not saved stays on this device: over a reload, sleep, or a service that was away. */
import { remember, remembered } from "../../storage";

export interface Draft {
  text: string;
  /** The version that it was made of; 0 for a new machine. */
  base: number;
}

const place = (machine: string): string => `hilfit.draft.${machine}`;

export function storedDraft(machine: string): Draft | null {
  const held = remembered(place(machine));
  if (held === null) return null;
  try {
    const { text, base } = JSON.parse(held) as Partial<Draft>;
    return typeof text === "string" && typeof base === "number" ? { text, base } : null;
  } catch {
    return null;
  }
}

export function storeDraft(machine: string, draft: Draft | null): void {
  remember(place(machine), draft === null ? null : JSON.stringify(draft));
}
