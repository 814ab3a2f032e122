/** Files of the service for the person: read with this device's token, then saved. */
import { useState } from "preact/hooks";
import { useSession } from "../session";
import { Button, Notice } from "../ui/controls";
import { saveFile } from "../ui/save";
import { t } from "../texts";

export interface Download {
  title: string;
  path: string;
  name: string;
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
