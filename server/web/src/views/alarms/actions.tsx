/** Acknowledge an alarm, keep it quiet for a while, let it be heard again. */
import { useEffect, useRef, useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { CommandNotice, useCommand } from "../../command";
import { useSession } from "../../session";
import { Button, Field, type InputEvent, type SelectEvent } from "../../ui/controls";
import { t } from "../../texts";
import { said } from "../../texts/report";

type Alarm = components["schemas"]["AlarmResource"];

const TIMES: [number, string][] = [
  [900, t("common.15Minutes")],
  [3600, t("alarms.1Hour")],
  [28800, t("alarms.8HoursShift")],
  [86400, t("alarms.1Day")],
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
            label={t("alarms.acknowledge", { text: said(alarm.text, alarm.text_message) })}
            onClick={() => void command.run({ method: "POST", path: `${path}/acknowledge` })}
          >
            {t("alarms.acknowledge2")}
          </Button>
        )}
        {shelved ? (
          <Button
            busy={command.busy}
            disabled={away}
            label={t("alarms.letHeardAgain", { text: said(alarm.text, alarm.text_message) })}
            onClick={() => void command.run({ method: "POST", path: `${path}/unshelve` })}
          >
            {t("alarms.letHeardAgain2")}
          </Button>
        ) : (
          alarm.state === "active" && (
            <Button
              disabled={command.busy || away}
              label={t("alarms.keepQuiet", { text: said(alarm.text, alarm.text_message) })}
              onClick={() => setAsking(!asking)}
            >
              {t("alarms.keepQuiet2")}
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
      <Field label={t("alarms.howLong")}>
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
      <Field label={t("common.why")} error={missing ? t("alarms.sayWhyNextShift") : null}>
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
          {t("alarms.keepQuiet3")}
        </Button>
        <Button onClick={onNo}>{t("alarms.back")}</Button>
      </div>
    </form>
  );
}
