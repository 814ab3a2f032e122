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
import { t } from "../../texts";

type Recording = components["schemas"]["RecordingResource"];

const WORDS: Partial<Record<Role, string>> = {
  unloaded: t("recalibrate.startMotionFreeCylinders"),
  train: t("recalibrate.startTrainingMotionArms"),
  repeat: t("recalibrate.startSameMotionAgain"),
  validate: t("recalibrate.startAnotherMotionNothing"),
};
const TIMES: [number, string][] = [
  [60, t("recalibrate.1Minute")],
  [120, t("recalibrate.2Minutes")],
  [300, t("recalibrate.5Minutes")],
  [900, t("common.15Minutes")],
  [0, t("recalibrate.untilIStop")],
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
          <Mark kind="recording">{t("recalibrate.recording")}</Mark> {t("recalibrate.for")}{" "}
          <Since iso={recording.created} />
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
          {t("recalibrate.stopGo")}
        </Button>
      </>
    );
  return (
    <>
      <p>{text}</p>
      {choice}
      {other !== undefined && (
        <Notice kind="warning">{t("recalibrate.somebodyRecordsMachineNow", { label: other.label })}</Notice>
      )}
      <Field label={t("recalibrate.atMost")}>
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
        {t("common.startRecording")}
      </Button>
    </>
  );
}
