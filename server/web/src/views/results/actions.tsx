/** What to do with a result: propose it as a calibration, take its files along. */
import { useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { CommandNotice, useCommand } from "../../command";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Button, Field, type InputEvent } from "../../ui/controls";
import { Panel } from "../../ui/layout";
import { Downloads } from "../downloads";

type Calibrations = components["schemas"]["CalibrationList"];
type Calibration = components["schemas"]["CalibrationResource"];
type Identification = components["schemas"]["IdentificationResource"];

const STATES: Record<Calibration["state"], string> = {
  proposed: "It is proposed as a calibration and waits for somebody to approve it.",
  approved: "It is an approved calibration that is not in use yet.",
  rejected: "It was proposed as a calibration and rejected.",
  active: "It is the calibration in use.",
  retired: "It was the calibration in use, until another one was.",
};

export function ResultActions({ identification }: { identification: Identification }) {
  const session = useSession();
  const command = useCommand();
  const [label, setLabel] = useState(identification.label);
  const path = `/calibrations?machine=${encodeURIComponent(identification.machine)}&limit=500`;
  const list = useResource<Calibrations>(path, "calibrations");
  const mine = list.value?.items.find((one) => one.identification === identification.id);
  const id = encodeURIComponent(identification.id);
  const name = `${identification.machine}-${identification.id}`;
  const files = [
    { title: "Report to read (HTML)", path: `/identifications/${id}/report.html`, name: `${name}-report.html` },
    { title: "Report as data (JSON)", path: `/identifications/${id}/report.json`, name: `${name}-report.json` },
  ];
  if (mine !== undefined)
    files.push({ title: "Model (JSON)", path: `/calibrations/${mine.id}/model.json`, name: `${name}-model.json` });
  return (
    <Panel title="Use this result">
      {mine !== undefined ? (
        <p>
          {STATES[mine.state]} <a href="#/calibrations">Calibrations</a>
        </p>
      ) : !session.may("operate") ? (
        <p class="hint">Your role looks only: an operator can propose this result as a calibration.</p>
      ) : (
        list.value !== null && (
          <form
            class="inline-form"
            onSubmit={(event) => {
              event.preventDefault();
              const json = { identification: identification.id, label };
              void command.run({ method: "POST", path: "/calibrations", json }, list.reload);
            }}
          >
            <Field label="Name of the calibration" hint="Another person approves it before it is used.">
              <input
                value={label}
                maxLength={200}
                autocomplete="off"
                onInput={(event: InputEvent) => setLabel(event.currentTarget.value)}
              />
            </Field>
            <Button kind="primary" type="submit" busy={command.busy} disabled={!session.online.value || list.stale}>
              Propose as calibration
            </Button>
          </form>
        )
      )}
      <CommandNotice of={command} />
      <h3>Files</h3>
      <Downloads files={files} />
      {mine === undefined && <p class="hint">The model as a file is there once the result is proposed.</p>}
    </Panel>
  );
}
