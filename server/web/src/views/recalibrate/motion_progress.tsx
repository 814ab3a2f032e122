/** While a motion is recorded: what it has covered so far, and that the recording ends when the arm is parked. */
import { useEffect, useRef, useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { useRegularly, useResource } from "../../resource";
import { Mark } from "../../ui/controls";
import { duration, percent } from "../../ui/format";
import type { Role } from "../../words";
import type { MachineContent } from "../live/groups";
import { type Coverage, progress, type WatchedMachine, watchedChannels } from "./motion_watch";
import { t } from "../../texts";

type Signals = components["schemas"]["Signals"];

const LOOK_MS = 1500;
/** s of rest after a motion that end its recording: longer than a motion pauses between two of its parts. */
export const PARKED_S = 8;
/** Longest that is looked back, s. */
const LONGEST_S = 8 * 3600;

interface MotionProgressProps {
  machine: string;
  content: MachineContent & WatchedMachine;
  role: Role;
  /** When the recording began, as the service says. */
  created: string;
  /** The motion is over; null while nothing can be stopped. */
  onParked: (() => void) | null;
}

export function MotionProgress({ machine, content, role, created, onParked }: MotionProgressProps) {
  const [stops, setStops] = useState(true);
  const told = useRef(false);
  const began = new Date(created).getTime() / 1000;
  const channels = watchedChannels(content.channels, role === "unloaded");
  // In steps, so that what is asked for is not another thing each second.
  const back = Math.min(LONGEST_S, 120 * (1 + Math.ceil(Math.max(0, Date.now() / 1000 - began) / 120)));
  const names = channels.map((one) => `&channel=${encodeURIComponent(one.name)}`).join("");
  const path = `/machines/${encodeURIComponent(machine)}/signals?seconds=${back}&moments=1500${names}`;
  const signals = useResource<Signals>(channels.length === 0 ? null : path, []);
  useRegularly(signals, LOOK_MS);
  const [last, setLast] = useState<Signals | null>(null);
  useEffect(() => {
    if (signals.value !== null) setLast(signals.value);
  }, [signals.value]);
  const now = last === null ? null : progress(last, channels, content, began);
  const parked = now !== null && now.moved && now.rest >= PARKED_S && !signals.stale;
  useEffect(() => {
    if (!parked || !stops || told.current || onParked === null) return;
    told.current = true; // a command is sent once
    onParked();
  }, [parked, stops, onParked === null]);
  if (channels.length === 0) return <p class="hint">{t("recalibrate.noPositionMeasuredPage")}</p>;
  return (
    <div class="motion-progress">
      <p role="status">
        {now === null || !now.moved ? (
          <Mark kind="info">{t("recalibrate.waitingArmMove")}</Mark>
        ) : now.rest < 1.5 ? (
          <Mark kind="recording">{t("recalibrate.theArmMoves")}</Mark>
        ) : (
          <Mark kind={parked ? "good" : "info"}>
            {t("recalibrate.parkedFor", {
              rest: duration(now.rest),
              ends: !parked && stops ? t("recalibrate.recordingEndsAfterS", { parkeds: PARKED_S }) : "",
            })}
          </Mark>
        )}
      </p>
      <label class="check">
        <input type="checkbox" checked={stops} onChange={() => setStops(!stops)} />
        {t("recalibrate.stopWhenArmHas", { parkeds: PARKED_S })}
      </label>
      {now !== null && <Covered coverage={now.coverage} unloaded={role === "unloaded"} />}
    </div>
  );
}

function Covered({ coverage, unloaded }: { coverage: Coverage[]; unloaded: boolean }) {
  return (
    <ul class="coverage" aria-label={t("recalibrate.whatMotionHasCovered")}>
      {coverage.map(({ joint, range, speed }) => (
        <li key={joint}>
          <span class="name">{joint}</span>
          <Share value={range} words={unloaded ? t("recalibrate.ofItsStroke") : t("recalibrate.ofItsRange")} />
          {!unloaded && <Share value={speed} words={t("recalibrate.ofItsSpeed")} />}
        </li>
      ))}
    </ul>
  );
}

function Share({ value, words }: { value: number | null; words: string }) {
  if (value === null) return null;
  return (
    <span class="share">
      <progress max={1} value={Math.min(1, value)} aria-label={`${percent(value)} ${words}`} />
      <span>
        {percent(value)} {words}
      </span>
    </span>
  );
}
