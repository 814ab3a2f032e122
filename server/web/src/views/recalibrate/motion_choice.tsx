/** A motion that the service designed: as a file for the arm's controller, or straight to the simulated machine's. */
import type { components } from "../../net/api.gen";
import { CommandNotice, useCommand } from "../../command";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Button, Field, Progress, type SelectEvent } from "../../ui/controls";
import { duration } from "../../ui/format";
import { saveFile } from "../../ui/save";
import type { Role } from "../../words";
import type { Guide } from "./progress";
import { t } from "../../texts";
import { said } from "../../texts/report";

type List = components["schemas"]["ExcitationList"];
type Job = components["schemas"]["JobResource"];

interface MotionProps {
  machine: string;
  role: Role;
  guide: Guide;
  onMotion: (id: string) => void;
}

export function MotionChoice({ machine, role, guide, onMotion }: MotionProps) {
  const session = useSession();
  const command = useCommand();
  const list = useResource<List>(`/excitations?machine=${encodeURIComponent(machine)}&limit=50`, [
    "excitations",
    "jobs",
  ]);
  const rods = role === "unloaded" ? "unpinned" : "pinned";
  const all = (list.value?.items ?? []).filter((one) => one.options.rods === rods);
  const done = all.filter((one) => one.state === "done");
  const under = all.find((one) => one.state === "queued" || one.state === "running");
  // What is repeated is the training motion.
  const chosen = guide.motions[role] ?? (role === "repeat" ? guide.motions.train : undefined) ?? done[0]?.id ?? "";
  const same = role === "validate" && chosen !== "" && chosen === guide.motions.train;
  return (
    <details class="motion">
      <summary>{t("recalibrate.motionFromService")}</summary>
      {done.length > 0 && (
        <>
          <Field label={t("common.motion")} error={same ? t("recalibrate.trainingMotionTakeAnother") : null}>
            <select value={chosen} onChange={(event: SelectEvent) => onMotion(event.currentTarget.value)}>
              {done.map((one) => (
                <option key={one.id} value={one.id}>
                  {one.label} ({duration(one.seconds)})
                </option>
              ))}
            </select>
          </Field>
          <div class="actions">
            <Button
              busy={command.busy}
              onClick={() =>
                void session.client.getText(`/excitations/${chosen}/motion.csv`).then((outcome) => {
                  if (outcome.kind === "done") saveFile(new Blob([outcome.value]), `${machine}-${chosen}.csv`);
                  else command.say({ kind: "bad", text: outcome.text });
                })
              }
            >
              {t("recalibrate.downloadController")}
            </Button>
            <Button
              busy={command.busy}
              disabled={!session.online.value}
              onClick={() =>
                void command.run({ method: "POST", path: `/excitations/${chosen}/send` }, () => {
                  onMotion(chosen);
                  command.say({ kind: "good", text: t("recalibrate.simulatedMachineHasMotion") });
                })
              }
            >
              {t("recalibrate.runSimulatedMachine")}
            </Button>
          </div>
        </>
      )}
      {under === undefined ? (
        <>
          <p class="hint">
            {done.length === 0 ? t("recalibrate.noneWasDesignedMachine") : t("recalibrate.letAnotherOneDesigned")}
          </p>
          <Button
            busy={command.busy}
            disabled={!session.online.value}
            onClick={() => {
              const label = t(
                role === "validate"
                  ? "common.validationMotion"
                  : role === "unloaded"
                    ? "recalibrate.freeCylindersMotion"
                    : "common.trainingMotion",
              );
              const json = { machine, rods, label: `${label} ${all.length + 1}`, seed: all.length };
              void command.run({ method: "POST", path: "/excitations", json });
            }}
          >
            {t("recalibrate.designAMotion")}
          </Button>
        </>
      ) : (
        <Designing job={under.job} />
      )}
      <CommandNotice of={command} />
    </details>
  );
}

function Designing({ job: id }: { job: string }) {
  const job = useResource<Job>(`/jobs/${id}`, "jobs");
  const text = job.value === null ? t("recalibrate.designingAMotion") : said(job.value.text, job.value.text_message);
  return <Progress fraction={job.value?.fraction ?? 0} text={text} />;
}
