/** Order an identification from the recordings that are chosen. */
import { useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { randomName } from "../../net/random";
import { go } from "../../routes";
import { CommandNotice, useCommand } from "../../command";
import { useSession } from "../../session";
import { Button, Field, type InputEvent, type SelectEvent } from "../../ui/controls";
import { Panel, Table } from "../../ui/layout";
import { ROLE_WORDS, type Role } from "../../words";
import { type Selection, advice } from "./selection";
import { t } from "../../texts";

type Recording = components["schemas"]["RecordingResource"];
type Made = Pick<components["schemas"]["IdentificationResource"], "job">;

interface IdentifyProps {
  machine: string;
  recordings: Recording[];
  selection: Selection;
  /** Whether the machine has valves whose commands are recorded. */
  valves: boolean;
  onRole: (id: string, role: Role) => void;
  onClear: () => void;
}

export function IdentifyPanel({ machine, recordings, selection, valves, onRole, onClear }: IdentifyProps) {
  const session = useSession();
  const command = useCommand();
  const [label, setLabel] = useState("");
  // One name for one order: if its answer is lost and somebody orders again, the service makes no second one.
  const [key, setKey] = useState(randomName);
  const chosen = recordings.filter((one) => selection[one.id] !== undefined);
  const { wrong, weak } = advice(chosen.map((one) => selection[one.id] as Role));
  if (!session.may("engineer"))
    return (
      <Panel title={t("recordings.identifyFromRecordings")}>
        <p class="hint">{t("recordings.engineerCanOrderIdentification")}</p>
      </Panel>
    );
  const movable = chosen.some((one) => selection[one.id] !== "validate");
  const order = (path: "/identifications" | "/valves"): void => {
    const json = {
      machine,
      label,
      recordings: chosen.map((one) => ({ id: one.id, role: selection[one.id] as Role })),
    };
    void command.run<Made>({ method: "POST", path, json, key }, (made) => {
      setKey(randomName());
      onClear();
      go(`#/jobs/${made.job}`);
    });
  };
  return (
    <Panel title={t("recordings.identifyFromRecordingsChosen", { count: chosen.length })}>
      {chosen.length > 0 && (
        <Table
          caption={t("recordings.chosenRecordings")}
          columns={[
            { name: "label", title: t("recordings.recording") },
            { name: "role", title: t("recordings.usedAs") },
          ]}
          rows={chosen.map((one) => ({
            key: one.id,
            label: one.label || one.id,
            role: (
              <select
                aria-label={t("recordings.useAs", { label: one.label || one.id })}
                value={selection[one.id]}
                onChange={(event: SelectEvent) => {
                  setKey(randomName());
                  onRole(one.id, event.currentTarget.value as Role);
                }}
              >
                {Object.entries(ROLE_WORDS).map(([name, words]) => (
                  <option key={name} value={name}>
                    {words}
                  </option>
                ))}
              </select>
            ),
          }))}
        />
      )}
      {wrong !== null ? (
        <p class="hint">{wrong}</p>
      ) : (
        <>
          {weak.length > 0 && (
            <ul class="plain-list hint">
              {weak.map((text) => (
                <li key={text}>{text}</li>
              ))}
            </ul>
          )}
          <Field label={t("common.labelOptional")}>
            <input
              value={label}
              maxLength={200}
              autocomplete="off"
              onInput={(event: InputEvent) => setLabel(event.currentTarget.value)}
            />
          </Field>
        </>
      )}
      <CommandNotice of={command} />
      <div class="actions">
        <Button
          kind="primary"
          busy={command.busy}
          disabled={wrong !== null || !session.online.value}
          onClick={() => order("/identifications")}
        >
          {t("common.identify")}
        </Button>
        {valves && (
          <Button busy={command.busy} disabled={!movable || !session.online.value} onClick={() => order("/valves")}>
            {t("recordings.identifyValves")}
          </Button>
        )}
        {chosen.length > 0 && <Button onClick={onClear}>{t("recordings.chooseNone")}</Button>}
      </div>
    </Panel>
  );
}
