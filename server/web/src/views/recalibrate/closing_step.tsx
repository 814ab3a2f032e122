/** The motion that an identification asked for: take its file to the controller, record it. */
import { Button, Notice } from "../../ui/controls";
import type { MachineContent } from "../live/groups";
import { Downloads } from "../downloads";
import type { WatchedMachine } from "./motion_watch";
import { type Guide, closingLabel, closingRole, type closingsOf } from "./progress";
import { RecordStep } from "./record_step";
import { t } from "../../texts";

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
      {free && <Notice kind="warning">{t("recalibrate.motionMadeWithRods")}</Notice>}
      <Downloads
        files={[
          {
            title: t("recalibrate.motionControllerCsv"),
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
        words={t("recalibrate.startMotionArmsController")}
        guide={guide}
        recording={closings[number]}
        onMotion={() => undefined}
      />
      <div class="actions">
        <Button onClick={() => keep({ closings: guide.closings.filter((_, index) => index !== number) })}>
          {t("recalibrate.doWithoutMotion")}
        </Button>
      </div>
    </>
  );
}
