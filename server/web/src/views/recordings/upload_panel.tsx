/** Upload a recording that was made elsewhere. */
import { useRef, useState } from "preact/hooks";
import { useSession } from "../../session";
import { Button, Field, Notice, type NoticeText, Progress, type SelectEvent } from "../../ui/controls";
import { ROLE_WORDS, type Role } from "../../words";
import { ENDINGS, refusal, upload } from "./upload";
import { t } from "../../texts";

interface UploadProps {
  machine: string;
  /** Nothing was recorded yet: it stands open. */
  first: boolean;
  onDone: () => void;
}

export function UploadPanel({ machine, first, onDone }: UploadProps) {
  const session = useSession();
  const [open] = useState(first); // what happens to files that were sent is read after the first of them
  const [role, setRole] = useState<Role>("train");
  const [files, setFiles] = useState<File[]>([]);
  const [now, setNow] = useState<{ name: string; fraction: number } | null>(null);
  const [notices, setNotices] = useState<NoticeText[]>([]);
  const stop = useRef<(() => void) | null>(null);
  const input = useRef<HTMLInputElement>(null);
  const wrong = files.map(refusal).find((text) => text !== null) ?? null;

  const send = async (): Promise<void> => {
    setNotices([]);
    for (const [at, file] of files.entries()) {
      setNow({ name: file.name, fraction: 0 });
      const order = { file, machine, role, headers: session.client.headers() };
      const sent = upload(order, (fraction) => setNow({ name: file.name, fraction }));
      stop.current = sent.abort;
      const outcome = await sent.outcome;
      stop.current = null;
      const notice: NoticeText =
        outcome.kind === "done"
          ? { kind: "good", text: t("recordings.isStored", { name: file.name }) }
          : { kind: outcome.kind === "refused" ? "bad" : "warning", text: outcome.text };
      setNotices((before) => [...before, notice]);
      if (outcome.kind === "done") continue;
      // Whoever stands there decides whether the others shall follow.
      const rest = files.slice(at + 1).map((one) => t("common.quoted", { text: one.name }));
      if (rest.length > 0)
        setNotices((before) => [
          ...before,
          { kind: "info", text: t("recordings.notSentChooseAgain", { files: rest.join(", ") }) },
        ]);
      break;
    }
    setNow(null);
    setFiles([]);
    if (input.current !== null) input.current.value = "";
    onDone();
  };

  return (
    <section class="panel" aria-label={t("recordings.uploadARecording")}>
      <details open={open}>
        <summary>{t("recordings.uploadARecording")}</summary>
        {!session.may("operate") ? (
          <p class="hint">{t("recordings.yourRoleLooksOnly")}</p>
        ) : (
          <form
            onSubmit={(event) => {
              event.preventDefault();
              void send();
            }}
          >
            <Field label={t("recordings.whatMachineDid")}>
              <select value={role} onChange={(event: SelectEvent) => setRole(event.currentTarget.value as Role)}>
                {Object.entries(ROLE_WORDS).map(([name, words]) => (
                  <option key={name} value={name}>
                    {words}
                  </option>
                ))}
              </select>
            </Field>
            <Field label={t("common.files")} hint={t("recordings.csvParquetMdf4Mat")} error={wrong}>
              {(attributes) => (
                <input
                  {...attributes}
                  ref={input}
                  type="file"
                  multiple
                  accept={ENDINGS.join(",")}
                  disabled={now !== null}
                  onChange={(event) => {
                    setNotices([]);
                    setFiles([...(event.currentTarget.files ?? [])]);
                  }}
                />
              )}
            </Field>
            {now !== null && (
              <Progress
                fraction={now.fraction}
                text={
                  now.fraction >= 1
                    ? t("recordings.sentServiceChecks", { name: now.name })
                    : t("recordings.ofSent", { name: now.name })
                }
              />
            )}
            {notices.map((notice, index) => (
              <Notice key={index} kind={notice.kind}>
                {notice.text}
              </Notice>
            ))}
            <div class="actions">
              <Button
                kind="primary"
                type="submit"
                busy={now !== null}
                disabled={files.length === 0 || wrong !== null || !session.online.value}
              >
                {files.length > 1 ? t("recordings.uploadFiles", { count: files.length }) : t("recordings.upload")}
              </Button>
              {now !== null && now.fraction < 1 && (
                <Button onClick={() => stop.current?.()}>{t("recordings.breakOff")}</Button>
              )}
            </div>
          </form>
        )}
      </details>
    </section>
  );
}
