/** What the DBC files of a bus offer: messages, signals, which channels use them; the files; a channel of a signal. */
import { useState } from "preact/hooks";
import { CommandNotice, useCommand } from "../../command";
import type { components } from "../../net/api.gen";
import { query } from "../../net/client";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Button, Field, Notice } from "../../ui/controls";
import { count, DASH, spelt } from "../../ui/format";
import { Confirm, Panel, Table } from "../../ui/layout";
import { Downloads } from "../downloads";
import { useSettled } from "../settled";
import { NewChannel } from "./new_channel";
import { t } from "../../texts";
import { said } from "../../texts/report";

type List = components["schemas"]["CanSignalList"];
type Signal = components["schemas"]["CanSignal"];
type File_ = components["schemas"]["CanFile"];

interface CanSignalsProps {
  machine: string;
  bus: string;
  joints: string[];
  onInsert: ((line: string) => number | null) | null;
}

export function CanSignals({ machine, bus, joints, onInsert }: CanSignalsProps) {
  const [search, setSearch] = useState("");
  const [chosen, setChosen] = useState<Signal | null>(null);
  const settled = useSettled(search.trim());
  const list = useResource<List>(`/can-signals${query({ machine, bus, search: settled })}`, ["machines"]);
  // What was found before stays while the next search is under way.
  const [shown, setShown] = useState<List | null>(null);
  if (list.value !== null && list.value !== shown) setShown(list.value);
  const found = list.value ?? shown;
  const own = found?.buses.find((one) => one.name === bus);
  return (
    <Panel title={t("canSignals.title", { bus })}>
      <p class="hint">{t("canSignals.hint")}</p>
      {list.error !== null && <Notice kind="bad">{list.error}</Notice>}
      {found === null && list.loading && <p role="status">{t("canSignals.reading")}</p>}
      {own !== undefined && (
        <>
          <Files machine={machine} bus={bus} files={own.files} onReplaced={list.reload} />
          {own.problems
            .filter((line) => own.files.every((file) => file.error !== line))
            .map((line) => (
              <Notice key={line} kind="warning">
                {said(line, own.messages[line])}
              </Notice>
            ))}
        </>
      )}
      <Field label={t("canSignals.search", { bus })} hint={t("canSignals.searchHint")}>
        {(attributes) => (
          <input
            {...attributes}
            type="search"
            maxLength={200}
            value={search}
            onInput={(event) => setSearch(event.currentTarget.value)}
          />
        )}
      </Field>
      {chosen !== null && found !== null && (
        <NewChannel
          key={`${chosen.file}/${chosen.message}/${chosen.signal}`}
          signal={chosen}
          quantities={found.quantities}
          joints={joints}
          onInsert={onInsert}
          onClose={() => setChosen(null)}
        />
      )}
      {found !== null && <Signals bus={bus} list={found} onChoose={setChosen} />}
      {own !== undefined && own.left_out > 0 && (
        <p class="hint">{t("canSignals.leftOut", { count: count(own.left_out) })}</p>
      )}
    </Panel>
  );
}

function Signals({ bus, list, onChoose }: { bus: string; list: List; onChoose: (signal: Signal) => void }) {
  if (list.found === 0) return <p role="status">{t("canSignals.noneFound")}</p>;
  return (
    <>
      <Table
        caption={t("canSignals.signalsOf", { bus })}
        columns={[
          { name: "signal", title: t("canSignals.signal") },
          { name: "message", title: t("canSignals.message") },
          { name: "place", title: t("canSignals.place") },
          { name: "value", title: t("canSignals.value") },
          { name: "channels", title: t("canSignals.channels") },
          { name: "use", title: "" },
        ]}
        rows={list.items.map((one) => ({
          key: `${one.file}/${one.message}/${one.signal}`,
          signal: (
            <>
              <strong>{one.signal}</strong>
              <Hint text={multiplexOf(one)} />
            </>
          ),
          message: (
            <>
              {one.message}
              <Hint text={identifierOf(one)} />
            </>
          ),
          place: placeOf(one),
          value: valueOf(one),
          channels: one.channels.length === 0 ? DASH : one.channels.join(", "),
          use:
            one.source === null ? (
              <span class="hint">{said(one.refusal ?? "", one.refusal_message)}</span>
            ) : (
              <Button label={t("canSignals.use", { signal: one.signal })} onClick={() => onChoose(one)}>
                {t("canSignals.useShort")}
              </Button>
            ),
        }))}
      />
      {list.found > list.items.length && (
        <p class="hint">{t("canSignals.more", { shown: count(list.items.length), found: count(list.found) })}</p>
      )}
    </>
  );
}

function Hint({ text }: { text: string }) {
  return text === "" ? null : <div class="hint">{text}</div>;
}

const hex = (value: number, digits: number): string => `0x${value.toString(16).toUpperCase().padStart(digits, "0")}`;

/** Identifier with 3 digits (11 bits) or 8 (29 bits), and the PGN of J1939. */
export function identifierOf(signal: Signal): string {
  const identifier = hex(signal.frame_id, signal.extended ? 8 : 3);
  return signal.pgn === null ? identifier : `${identifier}, ${t("canSignals.pgn", { pgn: hex(signal.pgn, 4) })}`;
}

export function multiplexOf(signal: Signal): string {
  if (signal.selects) return t("canSignals.selects");
  if (signal.multiplexer === null) return "";
  return t("canSignals.where", { multiplexer: signal.multiplexer, values: signal.multiplexer_values.join(", ") });
}

function placeOf(signal: Signal): string {
  const order = signal.byte_order === "big" ? t("canSignals.big") : t("canSignals.little");
  return t("canSignals.bits", { start: signal.start_bit, bits: signal.bits, order });
}

/** All the digits that the file has. */
const exact = (value: number | null): string => (value === null ? DASH : spelt(String(value)));

function valueOf(signal: Signal): string {
  const size = signal.offset === null ? null : Math.abs(signal.offset);
  const offset = size === 0 ? "" : `${(signal.offset ?? 0) < 0 ? "−" : "+"} ${exact(size)}`;
  const formula = t("canSignals.formula", { factor: exact(signal.factor), offset }).trimEnd();
  return signal.unit === "" ? formula : `${formula} ${signal.unit}`;
}

interface FilesProps {
  machine: string;
  bus: string;
  files: File_[];
  onReplaced: () => void;
}

function Files({ machine, bus, files, onReplaced }: FilesProps) {
  const session = useSession();
  const command = useCommand();
  const [asked, setAsked] = useState<{ file: File_; by: File } | null>(null);
  const engineer = session.may("engineer");

  async function send(file: File_, by: File): Promise<void> {
    setAsked(null);
    const path = `/can-signals/upload${query({ machine, name: file.name })}`;
    const outcome = await command.run({ method: "POST", path, file: by, etag: `"${file.sha256 ?? ""}"` });
    if (outcome.kind === "done") command.say({ kind: "good", text: t("canSignals.replaced", { name: file.name }) });
    onReplaced();
  }

  return (
    <>
      <Table
        caption={t("canSignals.filesOf", { bus })}
        columns={[
          { name: "name", title: t("canSignals.file") },
          { name: "content", title: t("canSignals.content") },
          { name: "actions", title: "" },
        ]}
        rows={files.map((file) => ({
          key: file.name,
          name: file.name,
          content:
            (file.error ? said(file.error, file.error_message) : null) ??
            t("canSignals.counts", { messages: count(file.messages), signals: count(file.signals) }),
          actions: (
            <>
              {file.sha256 !== null && (
                <Downloads
                  files={[
                    {
                      title: t("canSignals.downloadOne", { name: file.name }),
                      path: `/can-signals/file${query({ machine, name: file.name })}`,
                      name: file.name.split("/").pop() ?? file.name,
                    },
                  ]}
                />
              )}
              {engineer && (
                <Field label={t("canSignals.replaceOne", { name: file.name })}>
                  {(attributes) => (
                    <input
                      {...attributes}
                      type="file"
                      accept=".dbc,.kcd,.sym,.arxml"
                      disabled={command.busy || !session.online.value}
                      onChange={(event) => {
                        const by = event.currentTarget.files?.[0];
                        event.currentTarget.value = "";
                        if (by !== undefined) setAsked({ file, by });
                      }}
                    />
                  )}
                </Field>
              )}
            </>
          ),
        }))}
      />
      <CommandNotice of={command} />
      {asked !== null && (
        <Confirm
          title={t("canSignals.replaceQuestion", { name: asked.file.name })}
          text={t("canSignals.replaceText", { file: asked.by.name })}
          confirm={t("canSignals.replace")}
          onNo={() => setAsked(null)}
          onYes={() => void send(asked.file, asked.by)}
        />
      )}
    </>
  );
}
