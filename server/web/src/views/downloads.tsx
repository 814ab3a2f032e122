/** Files of the service for the person: read with this device's token, then saved. */
import { useState } from "preact/hooks";
import { useSession } from "../session";
import { Button, Notice } from "../ui/controls";
import { saveFile } from "../ui/save";
import { t } from "../texts";
import { language } from "../texts/language";

export interface Download {
  title: string;
  path: string;
  name: string;
}

/** Where the page of an identification's report is, in the language that this page is shown in. */
export function reportPage(identification: string): string {
  return `/identifications/${encodeURIComponent(identification)}/report.html?language=${language}`;
}

export function Downloads({ files }: { files: Download[] }) {
  const session = useSession();
  const [busy, setBusy] = useState<string | null>(null);
  const [problem, setProblem] = useState<string | null>(null);
  const get = async (file: Download): Promise<void> => {
    setBusy(file.path);
    setProblem(null);
    const outcome = await session.client.getBlob(file.path);
    setBusy(null);
    if (outcome.kind === "done") saveFile(outcome.value, file.name);
    else setProblem(outcome.text);
  };
  return (
    <>
      <div class="actions">
        {files.map((file) => (
          <Button
            key={file.path}
            busy={busy === file.path}
            disabled={busy !== null || !session.online.value}
            label={t("downloads.download", { title: file.title })}
            onClick={() => void get(file)}
          >
            {file.title}
          </Button>
        ))}
      </div>
      {problem !== null && <Notice kind="bad">{problem}</Notice>}
    </>
  );
}
