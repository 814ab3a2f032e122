/** Signs, drawn as lines on a grid of 24; each stands beside words or has none of its own. */
const PATHS = {
  live: "M2 13h4l3-8 5 14 3-9 1.5 3H22",
  alarm: "M12 3 22 20H2L12 3Zm0 6v5m0 3v.5",
  recalibrate: "M4 12a8 8 0 0 1 14-5l2 2m0-5v5h-5M20 12a8 8 0 0 1-14 5l-2-2m0 5v-5h5",
  result: "M4 20V4m0 16h16M8 16v-4m4 4V8m4 8v-6",
  recording: "M12 4a8 8 0 1 0 0 16 8 8 0 0 0 0-16Zm0 5a3 3 0 1 0 0 6 3 3 0 0 0 0-6Z",
  job: "M4 6h16M4 12h10M4 18h6m7-3 2 2 3-4",
  calibration: "M12 3v3m0 12v3M3 12h3m12 0h3M12 8a4 4 0 1 0 0 8 4 4 0 0 0 0-8Z",
  schedule: "M4 6h16v14H4V6Zm0 4h16M8 3v5m8-5v5m-4 5v3l2 1",
  machine: "M4 20h8M6 20v-6l7-7 6 3m-6-3a2 2 0 1 1 .1 0ZM19 10v5m-2 2 2-2 2 2",
  pose: "M3 20h8M7 20v-5l4-7 8-2M11 8l5 6M7 15a1 1 0 1 0 .1 0M11 8a1 1 0 1 0 .1 0",
  history: "M4 12a8 8 0 1 0 3-6.2L4 8m0-4v4h4m4-1v5l4 2",
  fleet: "M3 4h7v7H3Zm11 0h7v7h-7ZM3 14h7v6H3Zm11 0h7v6h-7Z",
  service: "M4 4h16v6H4Zm0 10h16v6H4ZM7 7h.1M7 17h.1M11 7h6m-6 10h6",
  valve: "M3 9v10l18-10v10L3 9Zm9 5V5M8 5h8",
  more: "M5 12h.1M12 12h.1M19 12h.1",
  sun: "M12 8a4 4 0 1 0 0 8 4 4 0 0 0 0-8Zm0-5v2m0 14v2M3 12h2m14 0h2M5.6 5.6 7 7m10 10 1.4 1.4M5.6 18.4 7 17M17 7l1.4-1.4",
  moon: "M20 14A8 8 0 1 1 10 4a6.5 6.5 0 0 0 10 10Z",
} as const;
export type IconName = keyof typeof PATHS;

export function Icon({ name }: { name: IconName }) {
  const width = name === "more" ? 4 : 2;
  return (
    <svg class="icon" viewBox="0 0 24 24" aria-hidden="true" focusable="false">
      <path
        d={PATHS[name]}
        fill="none"
        stroke="currentColor"
        stroke-width={width}
        stroke-linecap="round"
        stroke-linejoin="round"
      />
    </svg>
  );
}
