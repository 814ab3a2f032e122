/** One recording of a guide: start, watch, stop. */
import { useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { CommandNotice, useCommand } from "../../command";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Button, Field, Mark, Notice, type SelectEvent } from "../../ui/controls";
import type { Role } from "../../words";
import type { MachineContent } from "../live/groups";
import { Since } from "../live/record_panel";
import { MotionChoice } from "./motion_choice";
import { MotionProgress } from "./motion_progress";
import type { WatchedMachine } from "./motion_watch";
import type { Guide } from "./progress";

type Recording = components["schemas"]["RecordingResource"];

const WORDS: Partial<Record<Role, string>> = {
  unloaded: "Start the motion of the free cylinders on the arm’s controller, and record it.",
  train: "Start the training motion on the arm’s controller, and record all of it.",
  repeat: "Start the same motion again, soon: what differs between the two is noise.",
  validate: "Start another motion. Nothing is fitted to it: it tells whether the result is true.",
};
const TIMES: [number, string][] = [
  [60, "1 minute"],
  [120, "2 minutes"],
  [300, "5 minutes"],
  [900, "15 minutes"],
  [0, "until I stop it"],
];

interface RecordProps {
  machine: string;
  content: (MachineContent & WatchedMachine) | undefined;
  role: Role;
  label: string;
  /** What to do, where it is not what the role says; the motion is at hand then. */
  words?: string;
  guide: Guide;
  recording: Recording | undefined;
  onMotion: (id: string) => void;
}

export function RecordStep({ machine, content, role, label, words, guide, recording, onMotion }: RecordProps) {
  const session = useSession();
  const command = useCommand();
  const [seconds, setSeconds] = useState(300);
  const away = !session.online.value;
  const text = words ?? WORDS[role];
  const choice =
    words === undefined ? <MotionChoice machine={machine} role={role} guide={guide} onMotion={onMotion} /> : null;
  const others = useResource<components["schemas"]["RecordingList"]>(
    `/recordings?machine=${encodeURIComponent(machine)}&state=recording&limit=1`,
    "recordings",
  );
  const other = others.value?.items.find((one) => one.label !== label);

  const stop = (id: string): void => void command.run({ method: "POST", path: `/recordings/${id}/stop` });

  if (recording?.state === "recording")
    return (
      <>
        <p class="now-recording">
          <Mark kind="recording">Recording</Mark> for <Since iso={recording.created} />
        </p>
        <p>{text}</p>
        {content !== undefined && (
          <MotionProgress
            key={recording.id}
            machine={machine}
            content={content}
            role={role}
            created={recording.created}
            onParked={away || command.busy ? null : () => stop(recording.id)}
          />
        )}
        {choice}
        <CommandNotice of={command} />
        <Button kind="danger" busy={command.busy} disabled={away} onClick={() => stop(recording.id)}>
          Stop and go on
        </Button>
      </>
    );
  return (
    <>
      <p>{text}</p>
      {choice}
      {other !== undefined && <Notice kind="warning">Somebody records this machine now: “{other.label}”.</Notice>}
      <Field label="At most">
        <select
          value={String(seconds)}
          onChange={(event: SelectEvent) => setSeconds(Number(event.currentTarget.value))}
        >
          {TIMES.map(([value, words]) => (
            <option key={value} value={String(value)}>
              {words}
            </option>
          ))}
        </select>
      </Field>
      <CommandNotice of={command} />
      <Button
        kind="primary"
        busy={command.busy}
        disabled={away || other !== undefined}
        onClick={() => {
          const json = { machine, role, label, seconds: seconds === 0 ? null : seconds };
          void command.run({ method: "POST", path: "/recordings", json });
        }}
      >
        Start recording
      </Button>
    </>
  );
}
