/** Recalibration step by step; whoever reloads the page, or comes from another one, goes on where it was. */
import { useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { randomName } from "../../net/random";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Button, Mark, Notice } from "../../ui/controls";
import { Confirm, Empty, Panel } from "../../ui/layout";
import { stamp } from "../../ui/format";
import type { MachineContent } from "../live/groups";
import { CheckStep } from "./check_step";
import { ClosingStep } from "./closing_step";
import { IdentifyStep } from "./identify_step";
import type { WatchedMachine } from "./motion_watch";
import { RecordStep } from "./record_step";
import {
  closingsOf,
  recordingLabel,
  type Guide,
  STEPS,
  type Step,
  currentStep,
  newGuide,
  recordingsOf,
  storeGuide,
  storedGuide,
} from "./progress";
import { t } from "../../texts";

type Recordings = components["schemas"]["RecordingList"];
type Machine = components["schemas"]["MachineDetail"];

const TITLES: Record<Step, string> = {
  check: t("recalibrate.checkTheSensors"),
  unpin: t("recalibrate.unpinTheRods"),
  unloaded: t("recalibrate.recordFreeCylinders"),
  pin: t("recalibrate.pinTheRods"),
  train: t("recalibrate.recordTrainingMotion"),
  repeat: t("recalibrate.recordOnceMore"),
  validate: t("recalibrate.recordAnotherMotion"),
  closing: t("recalibrate.recordMotionTellsCauses"),
  identify: t("common.identify"),
};

export default function RecalibrateView() {
  const session = useSession();
  const machine = session.machine.value;
  if (machine === null)
    return (
      <>
        <h1 class="title">{t("common.recalibrate")}</h1>
        <Empty>{t("common.thereNoMachineYet")}</Empty>
      </>
    );
  return <MachineGuide key={machine} machine={machine} />;
}

function MachineGuide({ machine }: { machine: string }) {
  const session = useSession();
  const [stored, setGuide] = useState(() => storedGuide(machine));
  const path = stored === null ? null : `/recordings?machine=${encodeURIComponent(machine)}&limit=200`;
  const recordings = useResource<Recordings>(path, "recordings");
  const [asking, setAsking] = useState(false);
  const detail = useResource<Machine>(`/machines/${encodeURIComponent(machine)}`, "machines");
  const content = detail.value?.machine as unknown as (MachineContent & WatchedMachine) | undefined;
  // Without cylinders there is nothing to unpin; the guide does not speak of it.
  const cylinders = content === undefined || content.joints.some((joint) => joint.cylinder != null);
  const guide = stored === null || cylinders ? stored : { ...stored, stayOn: true };

  function keep(change: Partial<Guide> | null): void {
    const next = change === null || guide === null ? null : { ...guide, ...change };
    storeGuide(machine, next);
    setGuide(next);
  }
  function begin(): void {
    const key = randomName();
    const label = t("recalibrate.recalibration", {
      date: stamp(new Date()),
      key: key.slice(0, 4),
    });
    const fresh = newGuide(label, key);
    storeGuide(machine, fresh);
    setGuide(fresh);
  }

  if (guide === null) return <Begin onBegin={begin} allowed={session.may("engineer")} cylinders={cylinders} />;
  if (recordings.value === null)
    return (
      <>
        <h1 class="title">{t("recalibrate.recalibrate", { machine })}</h1>
        {recordings.error === null ? (
          <p role="status">{t("common.reading")}</p>
        ) : (
          <Notice kind="bad">{recordings.error}</Notice>
        )}
      </>
    );
  const mine = recordingsOf(guide, recordings.value.items);
  const closings = closingsOf(guide, recordings.value.items);
  const step = currentStep(guide, mine, closings);
  return (
    <div class={recordings.stale ? "stale" : ""}>
      <h1 class="title">{t("recalibrate.recalibrate", { machine })}</h1>
      <div class="guide">
        <StepList step={step} guide={guide} />
        <div>
          <Panel title={`${position(step, guide)}. ${TITLES[step]}`}>
            <StepContent
              step={step}
              machine={machine}
              content={content}
              guide={guide}
              recordings={mine}
              closings={closings}
              keep={keep}
            />
          </Panel>
          <Button onClick={() => setAsking(true)}>{t("recalibrate.endThisGuide")}</Button>
        </div>
      </div>
      {asking && (
        <Confirm
          title={t("recalibrate.endThisGuide2")}
          text={t("recalibrate.whatWasRecordedStays")}
          confirm={t("common.endIt")}
          kind="danger"
          onNo={() => setAsking(false)}
          onYes={() => {
            setAsking(false);
            keep(null);
          }}
        />
      )}
    </div>
  );
}

interface ContentProps {
  step: Step;
  machine: string;
  content: (MachineContent & WatchedMachine) | undefined;
  guide: Guide;
  recordings: ReturnType<typeof recordingsOf>;
  closings: ReturnType<typeof closingsOf>;
  keep: (change: Partial<Guide> | null) => void;
}

function StepContent({ step, machine, content, guide, recordings, closings, keep }: ContentProps) {
  switch (step) {
    case "check":
      return <CheckStep machine={machine} onDone={() => keep({ checked: true })} />;
    case "unpin":
      return (
        <>
          <p>{t("recalibrate.parkArmSoHeld")}</p>
          <Notice kind="warning">{t("recalibrate.depressuriseSecureArmAs")}</Notice>
          <div class="actions">
            <Button kind="primary" onClick={() => keep({ unpinned: true })}>
              {t("recalibrate.allRodsOff")}
            </Button>
            <Button onClick={() => keep({ stayOn: true })}>{t("recalibrate.leaveRods")}</Button>
          </div>
          <p class="hint">{t("recalibrate.withRodsFrictionTold")}</p>
        </>
      );
    case "pin":
      return (
        <>
          <p>{t("recalibrate.putAllRodsBack")}</p>
          <Button kind="primary" onClick={() => keep({ pinned: true })}>
            {t("recalibrate.allRods")}
          </Button>
        </>
      );
    case "identify":
      return <IdentifyStep machine={machine} guide={guide} recordings={recordings} closings={closings} keep={keep} />;
    case "closing":
      return <ClosingStep machine={machine} content={content} guide={guide} closings={closings} keep={keep} />;
    default:
      return (
        <RecordStep
          key={step}
          machine={machine}
          content={content}
          role={step}
          label={recordingLabel(guide, step)}
          guide={guide}
          recording={recordings[step]}
          onMotion={(id) => keep({ motions: { ...guide.motions, [step]: id } })}
        />
      );
  }
}

function Begin({ onBegin, allowed, cylinders }: { onBegin: () => void; allowed: boolean; cylinders: boolean }) {
  return (
    <>
      <h1 class="title">{t("common.recalibrate")}</h1>
      <Panel title={t("common.whatHappens")}>
        <ol class="what">
          <li>{t("recalibrate.sensorsChecked")}</li>
          {cylinders && <li>{t("recalibrate.rodsUnpinnedEachCylinder")}</li>}
          <li>{cylinders ? t("recalibrate.rodsPinned") : t("recalibrate.trainingMotionRecordedTwice")}</li>
          <li>{t("recalibrate.serviceIdentifiesArmSays")}</li>
        </ol>
        <p>{t("recalibrate.motionsComeFromArms")}</p>
        {allowed ? (
          <Button kind="primary" onClick={onBegin}>
            {t("common.begin")}
          </Button>
        ) : (
          <Notice kind="info">{t("recalibrate.yourRoleCannotIdentify")}</Notice>
        )}
      </Panel>
    </>
  );
}

function used(guide: Guide): Step[] {
  const steps = guide.closings.length > 0 ? STEPS : STEPS.filter((step) => step !== "closing");
  return guide.stayOn ? steps.filter((step) => step !== "unloaded" && step !== "pin" && step !== "unpin") : steps;
}

function position(step: Step, guide: Guide): number {
  return used(guide).indexOf(step) + 1;
}

function StepList({ step, guide }: { step: Step; guide: Guide }) {
  const steps = used(guide);
  const at = steps.indexOf(step);
  return (
    <ol class="steps guide-steps" aria-label={t("recalibrate.steps")}>
      {steps.map((one, index) => (
        <li
          key={one}
          class={index < at ? "done" : index === at ? "now" : "later"}
          {...(index === at ? { "aria-current": "step" as const } : {})}
        >
          <Mark kind={index < at ? "good" : index === at ? "info" : "off"}>
            {TITLES[one]}
            {index < at && <span class="for-reader">{t("recalibrate.done")}</span>}
          </Mark>
        </li>
      ))}
    </ol>
  );
}
