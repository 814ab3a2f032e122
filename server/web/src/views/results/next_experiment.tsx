/** What to record next to tell apart what these recordings could not, and a way to have its motion designed. */
import type { components } from "../../net/api.gen";
import { CommandNotice, useCommand, useSession } from "../../session";
import { Button } from "../../ui/controls";
import { duration } from "../../ui/format";
import { Panel } from "../../ui/layout";
import { Downloads } from "../downloads";
import type { NextExperiment as Experiment, Report } from "./report";
import { readable, title } from "./wording";

type Excitation = components["schemas"]["ExcitationResource"];

export function NextExperiment({ id, report }: { id: string; report: Report }) {
  const next = report.loop.next_experiment;
  if (next === null || next === "") return null;
  if (typeof next === "string")
    return (
      <Panel title="Next experiment">
        <p>{readable(next)}</p>
      </Panel>
    );
  const separates = (next.separates ?? []).map((id) => title({ id, joint: null }, report));
  return (
    <Panel title="Next experiment">
      {next.motion && (
        <p>
          <strong>{readable(next.motion)}</strong>
        </p>
      )}
      {next.why && <p>{readable(next.why)}</p>}
      {separates.length > 0 && <p class="hint">It tells apart: {separates.join(", ")}.</p>}
      {(next.otherwise ?? []).length > 0 && (
        <details>
          <summary>What else would tell them apart</summary>
          <ul class="plain-list">
            {(next.otherwise ?? []).map((text) => (
              <li key={text}>{readable(text)}</li>
            ))}
          </ul>
        </details>
      )}
      {next.motion_file && (
        <Downloads
          files={[
            {
              title: "this motion (CSV)",
              path: `/identifications/${encodeURIComponent(id)}/next-experiment.csv`,
              name: `${report.machine}-${id}-${next.motion_file}`,
            },
          ]}
        />
      )}
      <Design machine={report.machine} next={next} />
    </Panel>
  );
}

function Design({ machine, next }: { machine: string; next: Experiment }) {
  const session = useSession();
  const command = useCommand();
  if (!session.may("engineer"))
    return <p class="hint">An engineer can have a motion designed; an operator records it.</p>;
  const rods = next.rods ?? "pinned";
  const seconds = next.seconds ?? null;
  return (
    <>
      <CommandNotice of={command} />
      <div class="actions">
        <Button
          busy={command.busy}
          disabled={!session.online.value}
          onClick={() => {
            const json = {
              machine,
              rods,
              label: "Next experiment",
              ...(seconds === null ? {} : { duration_s: seconds }),
            };
            void command.run<Excitation>({ method: "POST", path: "/excitations", json }, (made) =>
              command.say({ kind: "good", text: `The motion “${made.label}” is being designed; see Jobs.` }),
            );
          }}
        >
          Design a motion{seconds === null ? "" : ` of ${duration(seconds)}`}
        </Button>
        <a class="button" href="#/recalibrate">
          Record it in the guide
        </a>
        <a class="button" href="#/jobs">
          Jobs
        </a>
      </div>
    </>
  );
}
