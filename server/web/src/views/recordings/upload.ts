/** Send a file to the service, once, and tell how far it is. `fetch` cannot tell; an older interface can. */
import { API, type Outcome, query } from "../../net/client";
import type { components } from "../../net/api.gen";
import { t } from "../../texts";
import type { Message } from "../../texts/message";
import { said } from "../../texts/report";

type Recording = components["schemas"]["RecordingResource"];

export const ENDINGS = [".csv", ".parquet", ".txt", ".tsv", ".mf4", ".mat", ".db3", ".mcap"];
/** Characters of a file's name that the service keeps. */
const LONGEST = 200;
const UNKNOWN = t("recordings.unknownWhetherFileArrived");

export interface UploadOrder {
  file: File;
  machine: string;
  role: string;
  headers: Record<string, string>;
}

/** What is wrong with a file before a byte of it is sent; null if nothing is. */
export function refusal(file: { name: string; size: number }): string | null {
  if (!ENDINGS.some((ending) => file.name.toLowerCase().endsWith(ending)))
    return t("recordings.noneExportRecordingAs", { name: file.name, endings: ENDINGS.join(", ") });
  if (file.name.length > LONGEST)
    return t("recordings.hasNameMoreThan", { name: file.name.slice(0, 40), longest: LONGEST });
  if (file.size === 0) return t("recordings.emptyExportRecordingAgain", { name: file.name });
  return null;
}

/**
 * Send it. `progress` gets the fraction that left this device; at 1 the service still checks the file.
 * `request` is there for tests.
 */
export function upload(
  order: UploadOrder,
  progress: (fraction: number) => void,
  request: XMLHttpRequest = new XMLHttpRequest(),
): { outcome: Promise<Outcome<Recording>>; abort: () => void } {
  const path = `/recordings/upload${query({ machine: order.machine, role: order.role, name: order.file.name })}`;
  const outcome = new Promise<Outcome<Recording>>((resolve) => {
    request.open("POST", API + path);
    for (const [name, value] of Object.entries(order.headers)) request.setRequestHeader(name, value);
    request.setRequestHeader("Content-Type", "application/octet-stream");
    request.upload.onprogress = (event) => {
      if (event.lengthComputable && event.total > 0) progress(event.loaded / event.total);
    };
    request.onload = () => resolve(answered(request.status, request.responseText));
    request.onerror = () => resolve({ kind: "unknown", text: UNKNOWN });
    request.onabort = () =>
      resolve({ kind: "refused", status: 0, text: t("recordings.youBrokeUploadOff"), problem: null });
    request.send(order.file);
  });
  return { outcome, abort: () => request.abort() };
}

function answered(status: number, text: string): Outcome<Recording> {
  let content: unknown = null;
  try {
    content = JSON.parse(text);
  } catch {
    // A proxy between us and the service may answer with anything.
  }
  if (status >= 200 && status < 300 && content !== null)
    return { kind: "done", value: content as Recording, etag: null, location: null };
  const { detail, message } = (content ?? {}) as { detail?: unknown; message?: Message };
  return {
    kind: "refused",
    status,
    text: typeof detail === "string" ? said(detail, message) : t("common.theServiceAnswered", { status }),
    problem: null,
  };
}
