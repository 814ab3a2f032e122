/** The editor of a machine file: what is typed is kept, checked by the service, and never written over another's. */
import { useEffect, useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { CommandNotice, useCommand } from "../../command";
import { useSession } from "../../session";
import { Button, Notice } from "../../ui/controls";
import { Confirm } from "../../ui/layout";
import { saveFile } from "../../ui/save";
import { Differences } from "./differences";
import { storeDraft, storedDraft } from "./drafts";
import { type Fault, faultOf } from "./lines";
import { TextEditor } from "./text_editor";
import type { MachineText } from "./use_file";
import { t } from "../../texts";

type Check = components["schemas"]["MachineCheck"];
type Summary = components["schemas"]["MachineSummary"];

/** What another part of the page does to the text. */
export interface EditorHook {
  text: string;
  keep: (text: string) => void;
}

interface MachineEditorProps {
  name: string;
  newest: MachineText;
  onSaved: () => void;
  hook?: { current: EditorHook | null };
}

export function MachineEditor({ name, newest, onSaved, hook }: MachineEditorProps) {
  const session = useSession();
  const command = useCommand();
  const [draft, setDraft] = useState(() => storedDraft(name));
  const [fault, setFault] = useState<Fault | null>(null);
  const [asking, setAsking] = useState(false);
  const text = draft?.text ?? newest.text;
  // A draft of a version that is newer than what was read is saved: the reading follows.
  const changed = draft !== null && draft.text !== newest.text && draft.base <= newest.version;
  const overtaken = changed && draft.base < newest.version;
  const engineer = session.may("engineer");
  useEffect(() => {
    // What somebody else saved in the very same words needs no draft any more.
    if (draft !== null && draft.text === newest.text) forget();
  }, [newest]);

  function keep(typed: string): void {
    const next = { text: typed, base: draft?.base ?? newest.version };
    setDraft(next);
    storeDraft(name, next);
    setFault(null);
  }

  if (hook !== undefined) hook.current = { text, keep };

  function forget(): void {
    setDraft(null);
    storeDraft(name, null);
    setFault(null);
  }

  async function send(path: "/machines" | "/machines/check", base: number): Promise<void> {
    const order = { method: "POST", path, text } as const;
    const outcome = await command.run<Check | Summary>(path === "/machines" ? { ...order, etag: `"${base}"` } : order);
    if (outcome.kind === "done") {
      if (outcome.value.name !== name)
        command.say({
          kind: "warning",
          text: t("machines.fileNamesMachineNot", { name: outcome.value.name, name2: name }),
        });
      else if (path === "/machines/check") command.say({ kind: "good", text: t("machines.serviceFindsNoFault") });
      else {
        setDraft({ text, base: outcome.value.version });
        storeDraft(name, null);
        setFault(null);
        command.say({ kind: "good", text: t("machines.savedAsVersion", { version: outcome.value.version }) });
        onSaved();
      }
    } else if (outcome.kind === "refused" && outcome.status === 422) {
      setFault(faultOf(outcome.text));
      command.say(null);
    } else if (outcome.kind === "refused" && outcome.status === 412) onSaved(); // read what overtook us
  }

  return (
    <>
      {changed && !overtaken && <Notice kind="info">{t("machines.notSavedYetDevice")}</Notice>}
      {overtaken && draft !== null && (
        <Overtaken draft={draft.text} base={draft.base} newest={newest} onTake={() => setAsking(true)} />
      )}
      {fault !== null && (
        <Notice kind="bad">
          {fault.line !== null && <strong>{t("machines.line", { line: fault.line })}</strong>}
          {fault.text}
        </Notice>
      )}
      <TextEditor
        label={t("machines.machineFileOf", { name })}
        text={text}
        fault={fault}
        readOnly={!engineer}
        onText={keep}
      />
      <CommandNotice of={command} />
      <div class="actions">
        {engineer && (
          <>
            <Button
              kind="primary"
              busy={command.busy}
              disabled={!changed || !session.online.value}
              onClick={() => void send("/machines", newest.version)}
            >
              {overtaken
                ? t("machines.saveMineOverVersion", { version: newest.version })
                : t("machines.saveAsVersion", { version: newest.version + 1 })}
            </Button>
            <Button
              busy={command.busy}
              disabled={!session.online.value}
              onClick={() => void send("/machines/check", newest.version)}
            >
              {t("machines.check")}
            </Button>
            {changed && <Button onClick={() => setAsking(true)}>{t("machines.discardChanges")}</Button>}
          </>
        )}
        <Button onClick={() => saveFile(new Blob([text]), `${name}.yaml`)}>{t("machines.download")}</Button>
      </div>
      {changed && (
        <details>
          <summary>{t("machines.whatIChangedAgainst", { version: newest.version })}</summary>
          <Differences before={newest.text} after={text} caption={t("machines.myChanges")} />
        </details>
      )}
      {asking && (
        <Confirm
          title={t("machines.dropYourChanges")}
          text={t("machines.editorShowsVersionThen", { version: newest.version })}
          confirm={t("machines.dropThem")}
          kind="danger"
          onNo={() => setAsking(false)}
          onYes={() => {
            setAsking(false);
            forget();
            command.say(null);
          }}
        />
      )}
    </>
  );
}

interface OvertakenProps {
  draft: string;
  base: number;
  newest: MachineText;
  onTake: () => void;
}

/** Somebody saved a version while this one was being typed: both are shown, none is lost. */
function Overtaken({ draft, base, newest, onTake }: OvertakenProps) {
  return (
    <section class="overtaken" aria-label={t("machines.somebodyElseSavedVersion")}>
      <Notice kind="warning">{t("machines.somebodySavedVersionWhile", { version: newest.version, base })}</Notice>
      <Differences
        before={newest.text}
        after={draft}
        caption={t("machines.versionAgainstYours", { version: newest.version })}
      />
      <div class="actions">
        <Button onClick={onTake}>{t("machines.takeVersionInstead", { version: newest.version })}</Button>
        <Button onClick={() => saveFile(new Blob([newest.text]), `version-${newest.version}.yaml`)}>
          {t("machines.downloadVersion", { version: newest.version })}
        </Button>
      </div>
    </section>
  );
}
