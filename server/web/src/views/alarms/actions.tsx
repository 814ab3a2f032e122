/** Acknowledge an alarm, keep it quiet for a while, let it be heard again. */
import { useEffect, useRef, useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { CommandNotice, useCommand } from "../../command";
import { useSession } from "../../session";
import { Button, Field, type InputEvent, type SelectEvent } from "../../ui/controls";

type Alarm = components["schemas"]["AlarmResource"];

const TIMES: [number, string][] = [
  [900, "15 minutes"],
  [3600, "1 hour"],
  [28800, "8 hours (a shift)"],
  [86400, "1 day"],
];

export function AlarmActions({ alarm, shelved }: { alarm: Alarm; shelved: boolean }) {
  const session = useSession();
  const command = useCommand();
  const [asking, setAsking] = useState(false);
  const path = `/alarms/${alarm.id}`;
  const away = !session.online.value;
  return (
    <div class="alarm-actions">
      <div class="actions">
        {!alarm.acknowledged && (
          <Button
            kind="primary"
            busy={command.busy}
            disabled={away}
            label={`Acknowledge: ${alarm.text}`}
            onClick={() => void command.run({ method: "POST", path: `${path}/acknowledge` })}
          >
            Acknowledge
          </Button>
        )}
        {shelved ? (
          <Button
            busy={command.busy}
            disabled={away}
            label={`Let it be heard again: ${alarm.text}`}
            onClick={() => void command.run({ method: "POST", path: `${path}/unshelve` })}
          >
            Let it be heard again
          </Button>
        ) : (
          alarm.state === "active" && (
            <Button
              disabled={command.busy || away}
              label={`Keep quiet: ${alarm.text}`}
              onClick={() => setAsking(!asking)}
            >
              Keep quiet …
            </Button>
          )
        )}
      </div>
      {asking && !shelved && (
        <Shelf
          busy={command.busy}
          onNo={() => setAsking(false)}
          onYes={(seconds, reason) =>
            void command.run({ method: "POST", path: `${path}/shelve`, json: { seconds, reason } }, () =>
              setAsking(false),
            )
          }
        />
      )}
      <CommandNotice of={command} />
    </div>
  );
}

interface ShelfProps {
  busy: boolean;
  onYes: (seconds: number, reason: string) => void;
  onNo: () => void;
}

function Shelf({ busy, onYes, onNo }: ShelfProps) {
  const [seconds, setSeconds] = useState(3600);
  const [reason, setReason] = useState("");
  const [missing, setMissing] = useState(false);
  const first = useRef<HTMLSelectElement>(null);
  useEffect(() => first.current?.focus(), []);
  return (
    <form
      class="shelf"
      onSubmit={(event) => {
        event.preventDefault();
        if (reason.trim() === "") setMissing(true);
        else onYes(seconds, reason.trim());
      }}
    >
      <Field label="How long">
        <select
          ref={first}
          value={String(seconds)}
          onChange={(event: SelectEvent) => setSeconds(Number(event.currentTarget.value))}
        >
          {TIMES.map(([value, words]) => (
            <option key={value} value={String(value)}>
              {words}
            </option>
          ))}
        </select>
      </Field>
      <Field label="Why" error={missing ? "Say why: the next shift reads it." : null}>
        <input
          value={reason}
          maxLength={200}
          autocomplete="off"
          aria-invalid={missing}
          onInput={(event: InputEvent) => {
            setReason(event.currentTarget.value);
            setMissing(false);
          }}
        />
      </Field>
      <div class="actions">
        <Button type="submit" kind="primary" busy={busy}>
          Keep quiet
        </Button>
        <Button onClick={onNo}>Back</Button>
      </div>
    </form>
  );
}
