/** Commands: sent once, never again by themselves. */
import { useRef, useState } from "preact/hooks";
import type { Command, Outcome } from "./net/client";
import { useSession } from "./session";
import { Notice, type NoticeText } from "./ui/controls";
import { t } from "./texts";

export interface CommandState {
  busy: boolean;
  notice: NoticeText | null;
  /** Send it once. While one is under way nothing else is sent. */
  run<T = unknown>(command: Command, done?: (value: T, location: string | null) => void): Promise<Outcome<T>>;
  say(notice: NoticeText | null): void;
}

export function useCommand(): CommandState {
  const session = useSession();
  const [busy, setBusy] = useState(false);
  const [notice, say] = useState<NoticeText | null>(null);
  const under = useRef(false);

  async function run<T>(command: Command, done?: (value: T, location: string | null) => void): Promise<Outcome<T>> {
    if (under.current) {
      return { kind: "refused", status: 0, text: t("common.commandBeforeStillUnder"), problem: null };
    }
    under.current = true;
    setBusy(true);
    say(null);
    try {
      const outcome = await session.client.send<T>(command);
      if (outcome.kind === "refused") say({ kind: "bad", text: outcome.text });
      else if (outcome.kind === "unknown") say({ kind: "warning", text: outcome.text });
      else done?.(outcome.value, outcome.location);
      return outcome;
    } finally {
      under.current = false;
      setBusy(false);
    }
  }

  return { busy, notice, run, say };
}

/** What became of a command, if there is something to say. */
export function CommandNotice({ of }: { of: CommandState }) {
  return of.notice === null ? null : <Notice kind={of.notice.kind}>{of.notice.text}</Notice>;
}
