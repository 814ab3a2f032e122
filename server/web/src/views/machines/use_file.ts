/** The text of a machine file as the service has it now. */
import { useEffect, useState } from "preact/hooks";
import { useSession } from "../../session";

export interface MachineText {
  text: string;
  version: number;
}
export interface Held {
  file: MachineText | null;
  error: string | null;
}

/** One version of a machine file; it never changes, so it is read once. Null: nothing. */
export function useFile(machine: string, version: number | null): Held {
  const session = useSession();
  const [held, setHeld] = useState<Held>({ file: null, error: null });
  const renewals = session.renewals.value;
  const wanted = held.file?.version === version ? null : version;
  useEffect(() => {
    if (wanted === null) return undefined;
    let over = false;
    void session.client.getText(`/machines/${encodeURIComponent(machine)}/file?version=${wanted}`).then((outcome) => {
      if (over) return;
      if (outcome.kind === "done") setHeld({ file: { text: outcome.value, version: wanted }, error: null });
      else setHeld((now) => ({ ...now, error: outcome.text }));
    });
    return () => {
      over = true;
    };
  }, [session, machine, wanted, renewals]);
  return held;
}
