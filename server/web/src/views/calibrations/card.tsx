/** One calibration: what it is, what may be done with it, its numbers. */
import { useState } from "preact/hooks";
import { CommandNotice, useCommand } from "../../command";
import { useSession } from "../../session";
import { Button, Field, Mark } from "../../ui/controls";
import { number, time, withStd } from "../../ui/format";
import { Confirm, Table } from "../../ui/layout";
import { Downloads } from "../downloads";
import { change, parameterName, unit, verdictWords } from "../results/wording";
import { type Calibration, STATES, jointErrors, possible } from "./rules";

type Decision = "approve" | "reject" | "activate";

const QUESTIONS: Record<Decision, [string, string, string]> = {
  approve: ["Approve", "You say with your name that this model is right for this machine.", "Approve it"],
  reject: ["Reject", "It cannot be used then. The result and its recordings stay.", "Reject it"],
  activate: [
    "Use",
    "It takes the place of the calibration in use, which stays for rolling back. The monitor starts to learn anew.",
    "Use it from now on",
  ],
};

export function CalibrationCard({ calibration, onDone }: { calibration: Calibration; onDone: () => void }) {
  const session = useSession();
  const command = useCommand();
  const [asked, setAsked] = useState<Decision | null>(null);
  const [note, setNote] = useState("");
  const may = possible(calibration, session.principal.value, session.may("engineer"));
  const [kind, words] = STATES[calibration.state];
  const [, verdict] = verdictWords(calibration.verdict);
  const changed = calibration.overall.change_percent;
  const offered = (["approve", "activate", "reject"] as const).filter((one) => may[one]);
  const send = (decision: Decision): void => {
    setAsked(null);
    const path = `/calibrations/${encodeURIComponent(calibration.id)}/${decision}`;
    const order = { method: "POST", path, ...(decision === "activate" ? {} : { json: { note } }) } as const;
    void command.run(order, () => {
      setNote("");
      onDone();
    });
  };
  return (
    <li class="calibration">
      <div class="calibration-text">
        <h3>{calibration.label || calibration.id}</h3>
        <p>
          <Mark kind={kind}>{words}</Mark>
        </p>
        <p>
          {verdict}
          {typeof changed === "number" && changed !== 0 && `; error of all joints ${change(changed)}`}.{" "}
          <a href={`#/results/${calibration.identification}`}>View the result</a>
        </p>
        <p class="hint">
          Proposed by {calibration.proposed_by} {time(calibration.created)}
          {calibration.approved_by !== null && `, approved by ${calibration.approved_by}`}
          {calibration.activated !== null && `, in use since ${time(calibration.activated)}`}
          {calibration.state === "retired" && " until another one was"}
        </p>
        {calibration.note && <p class="note">“{calibration.note}”</p>}
        {may.why !== null && <p class="hint">{may.why}</p>}
      </div>
      <div class="actions">
        {offered.map((one, index) => (
          <Button
            key={one}
            kind={index === 0 && one !== "reject" && calibration.state !== "retired" ? "primary" : "plain"}
            busy={command.busy}
            disabled={!session.online.value}
            label={`${QUESTIONS[one][0]} ${calibration.label}`}
            onClick={() => setAsked(one)}
          >
            {one === "activate" ? (calibration.state === "retired" ? "Use again" : "Use") : QUESTIONS[one][0]}
          </Button>
        ))}
      </div>
      <div class="wide">
        <CommandNotice of={command} />
        <Numbers calibration={calibration} />
      </div>
      {asked !== null && (
        <Confirm
          title={`${QUESTIONS[asked][0]} “${calibration.label}”?`}
          text={
            <>
              <p>{QUESTIONS[asked][1]}</p>
              {asked !== "activate" && (
                <Field label="Note (optional)">
                  <textarea
                    rows={3}
                    maxLength={2000}
                    value={note}
                    onInput={(event) => setNote(event.currentTarget.value)}
                  />
                </Field>
              )}
            </>
          }
          confirm={QUESTIONS[asked][2]}
          kind={asked === "reject" ? "danger" : "primary"}
          onNo={() => setAsked(null)}
          onYes={() => send(asked)}
        />
      )}
    </li>
  );
}

function Numbers({ calibration }: { calibration: Calibration }) {
  const id = encodeURIComponent(calibration.id);
  return (
    <details>
      <summary>Errors, parameters, files</summary>
      <Table
        caption={`Errors of ${calibration.label} per joint`}
        columns={[
          { name: "joint", title: "Joint" },
          { name: "before", title: "Without additions", align: "right" },
          { name: "after", title: "Error", align: "right" },
          { name: "noise", title: "Noise", align: "right" },
          { name: "unit", title: "Unit" },
        ]}
        rows={jointErrors(calibration).map((one) => ({
          key: one.joint,
          joint: one.joint,
          before: number(one.before, 3),
          after: <strong>{number(one.after, 3)}</strong>,
          noise: number(one.noise, 3),
          unit: unit(one.unit),
        }))}
      />
      <Table
        caption={`Parameters of ${calibration.label}`}
        columns={[
          { name: "name", title: "Parameter" },
          { name: "value", title: "Value ± standard deviation", align: "right" },
          { name: "unit", title: "Unit" },
        ]}
        rows={calibration.parameters.map((one) => ({
          key: one.name,
          name: parameterName(one.name),
          value: <span class="number-cell">{withStd(one.value, one.std)}</span>,
          unit: unit(one.unit),
        }))}
      />
      <h3>Files</h3>
      <Downloads
        files={[
          {
            title: "Model (JSON)",
            path: `/calibrations/${id}/model.json`,
            name: `${calibration.machine}-${calibration.id}-model.json`,
          },
          {
            title: "Report (HTML)",
            path: `/identifications/${encodeURIComponent(calibration.identification)}/report.html`,
            name: `${calibration.machine}-${calibration.id}-report.html`,
          },
        ]}
      />
    </details>
  );
}
