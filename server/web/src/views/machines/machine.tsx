/** One machine: its file in an editor, checked by the service, saved as a new version, never over somebody else's. */
import { useRef, useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Button, Field, Mark, Notice, type SelectEvent } from "../../ui/controls";
import { time } from "../../ui/format";
import { Panel } from "../../ui/layout";
import { saveFile } from "../../ui/save";
import { acquisitionWords } from "../../words";
import { Differences } from "./differences";
import { CanSignals } from "./can_signals";
import { type EditorHook, MachineEditor } from "./editor";
import { inserted } from "./channel_lines";
import { useFile } from "./use_file";
import { t } from "../../texts";

type Machine = components["schemas"]["MachineDetail"];

export function MachinePage({ name }: { name: string }) {
  const machine = useResource<Machine>(`/machines/${encodeURIComponent(name)}`, ["machines", "acquisition"]);
  const session = useSession();
  const current = machine.value?.current ?? null;
  const newest = useFile(name, current);
  const editor = useRef<EditorHook | null>(null);
  const insert = (line: string): number | null => {
    const made = editor.current === null ? null : inserted(editor.current.text, line);
    if (made !== null) editor.current?.keep(made.text);
    return made?.line ?? null;
  };
  const state = machine.value?.acquisition.state;
  const [kind, words] = acquisitionWords(typeof state === "string" ? state : "off");
  return (
    <div class={machine.stale ? "stale" : ""}>
      <h1 class="title">{name}</h1>
      {machine.error !== null && <Notice kind="bad">{machine.error}</Notice>}
      {newest.error !== null && <Notice kind="bad">{newest.error}</Notice>}
      {machine.value !== null && (
        <p>
          <Mark kind={kind}>{words}</Mark>{" "}
          <span class="hint">{t("machines.versionChanged", { current: machine.value.current })}</span>{" "}
          <span class="hint">{time(machine.value.created)}</span>
        </p>
      )}
      {newest.file === null && newest.error === null && machine.error === null && (
        <p role="status">{t("common.reading")}</p>
      )}
      {newest.file !== null && (
        <Panel title={t("common.machineFile")}>
          {!session.may("engineer") && <p class="hint">{t("machines.youCanReadEngineer")}</p>}
          <MachineEditor name={name} newest={newest.file} onSaved={machine.reload} hook={editor} />
        </Panel>
      )}
      {machine.value !== null &&
        signalBuses(machine.value).map((bus) => (
          <CanSignals
            key={bus}
            machine={name}
            bus={bus}
            joints={namesIn(machine.value, "joints")}
            onInsert={session.may("engineer") && newest.file !== null ? insert : null}
          />
        ))}
      {machine.value !== null && newest.file !== null && machine.value.versions.length > 1 && (
        <Versions name={name} versions={machine.value.versions} newest={newest.file.text} />
      )}
      <p>
        <a href={`#/bus-check/${encodeURIComponent(name)}`}>{t("busCheck.title")}</a>
      </p>
      <p>
        <a href="#/machines">{t("common.allMachines")}</a>
      </p>
    </div>
  );
}

type Named = { name?: unknown; type?: unknown };

function partsOf(machine: Machine | null, key: string): Named[] {
  const parts: unknown = machine?.machine[key];
  return Array.isArray(parts) ? (parts as Named[]) : [];
}

function namesIn(machine: Machine | null, key: string): string[] {
  return partsOf(machine, key).map((part) => String(part.name));
}

/** Buses whose messages DBC files describe. */
function signalBuses(machine: Machine): string[] {
  return partsOf(machine, "buses")
    .filter((bus) => bus.type === "can_signals")
    .map((bus) => String(bus.name));
}

function Versions({ name, versions, newest }: { name: string; versions: number[]; newest: string }) {
  const earlier = versions.slice(1);
  const [chosen, setChosen] = useState<number | null>(null);
  const version = chosen ?? earlier[0] ?? null;
  const old = useFile(name, version);
  return (
    <Panel title={t("machines.earlierVersions")}>
      <Field label={t("machines.version")}>
        <select
          value={String(version ?? "")}
          onChange={(event: SelectEvent) => setChosen(Number(event.currentTarget.value))}
        >
          {earlier.map((one) => (
            <option key={one} value={String(one)}>
              {t("machines.version2", { one })}
            </option>
          ))}
        </select>
      </Field>
      {old.error !== null && <Notice kind="bad">{old.error}</Notice>}
      {old.file !== null && (
        <>
          <p class="hint">{t("machines.whatChangedFromVersion", { version: old.file.version })}</p>
          <Differences
            before={old.file.text}
            after={newest}
            caption={t("machines.fromVersionCurrentOne", { version: old.file.version })}
          />
          <Button
            onClick={() => {
              if (old.file !== null) saveFile(new Blob([old.file.text]), `${name}-version-${old.file.version}.yaml`);
            }}
          >
            {t("machines.downloadVersion", { version: old.file.version })}
          </Button>
        </>
      )}
    </Panel>
  );
}
