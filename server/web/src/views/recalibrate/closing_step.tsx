/** The motion that an identification asked for: take its file to the controller, record it. */
import { Button, Notice } from "../../ui/controls";
import type { MachineContent } from "../live/groups";
import { Downloads } from "../downloads";
import type { WatchedMachine } from "./motion_watch";
import { type Guide, closingLabel, closingRole, type closingsOf } from "./progress";
import { RecordStep } from "./record_step";

interface ClosingProps {
  machine: string;
  content: (MachineContent & WatchedMachine) | undefined;
  guide: Guide;
  closings: ReturnType<typeof closingsOf>;
  keep: (change: Partial<Guide> | null) => void;
}

export function ClosingStep({ machine, content, guide, closings, keep }: ClosingProps) {
  const number = closings.findIndex((one) => one?.state !== "sealed");
  const closing = guide.closings[number];
  if (closing === undefined) return null;
  const free = closing.rods === "unpinned";
  return (
    <>
      <p>
        <strong>{closing.text}</strong>
      </p>
      {free && (
        <Notice kind="warning">
          This motion is made with the rods unpinned: secure and depressurise the arm as your site demands, and take
          them off first. Put them on again afterwards.
        </Notice>
      )}
      <Downloads
        files={[
          {
            title: "Motion for the controller (CSV)",
            path: `/identifications/${encodeURIComponent(closing.identification)}/next-experiment.csv`,
            name: `${machine}-next-experiment.csv`,
          },
        ]}
      />
      <RecordStep
        key={`closing-${number}`}
        machine={machine}
        content={content}
        role={closingRole(closing)}
        label={closingLabel(guide, number)}
        words="Start this motion on the arm’s controller, and record all of it."
        guide={guide}
        recording={closings[number]}
        onMotion={() => undefined}
      />
      <div class="actions">
        <Button onClick={() => keep({ closings: guide.closings.filter((_, index) => index !== number) })}>
          Do without this motion
        </Button>
      </div>
    </>
  );
}
