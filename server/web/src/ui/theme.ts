/** Dark or light: what the device prefers, until somebody chooses; colours of drawings come from the style sheet. */
import { signal } from "@preact/signals";

export type Theme = "dark" | "light";
const KEY = "hilfit.theme";
const prefersDark = window.matchMedia("(prefers-color-scheme: dark)");

function stored(): Theme | null {
  try {
    const value = localStorage.getItem(KEY);
    return value === "dark" || value === "light" ? value : null;
  } catch {
    return null; // storage is forbidden on this device
  }
}

const chosen = signal<Theme | null>(stored());
const preferred = signal<Theme>(prefersDark.matches ? "dark" : "light");
prefersDark.addEventListener("change", (event) => {
  preferred.value = event.matches ? "dark" : "light";
  apply();
});

/** What is shown now. */
export const theme = signal<Theme>("light");

function apply(): void {
  const now = chosen.value ?? preferred.value;
  document.documentElement.dataset.theme = now;
  theme.value = now;
}
apply();

/** Change to the other one, and keep it on this device. */
export function switchTheme(): void {
  chosen.value = theme.value === "dark" ? "light" : "dark";
  try {
    localStorage.setItem(KEY, chosen.value);
  } catch {
    // It holds until the page is closed.
  }
  apply();
}

export interface Colours {
  text: string;
  grid: string;
  bad: string;
  warning: string;
  accent: string;
  font: string;
  series: string[];
}

/** Colours for what is drawn on a canvas. */
export function colours(): Colours {
  const style = getComputedStyle(document.documentElement);
  const read = (name: string, otherwise: string): string => style.getPropertyValue(name).trim() || otherwise;
  return {
    text: read("--text", "#000"),
    grid: read("--line", "#ccc"),
    bad: read("--bad", "#a00"),
    warning: read("--warning", "#850"),
    accent: read("--accent", "#05a"),
    font: "14px system-ui, sans-serif",
    series: [1, 2, 3, 4, 5, 6].map((index) => read(`--series-${index}`, "#06c")),
  };
}

/** `#rrggbb` with an opacity. */
export function transparent(colour: string, opacity: number): string {
  const match = /^#([0-9a-f]{6})$/i.exec(colour);
  if (match === null) return colour;
  const part = (at: number): number => Number.parseInt((match[1] as string).slice(at, at + 2), 16);
  return `rgba(${part(0)}, ${part(2)}, ${part(4)}, ${opacity})`;
}
