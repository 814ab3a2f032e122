/** A channel of a signal: what the machine file has to say of it, as one line. */
import { useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { Button, Field, Notice, type SelectEvent } from "../../ui/controls";
import { channelLine, channelName, likelyQuantity } from "./channel_lines";
import { t } from "../../texts";

type Signal = components["schemas"]["CanSignal"];
type Quantity = components["schemas"]["CanSignalQuantity"];

interface NewChannelProps {
  signal: Signal;
  quantities: Quantity[];
  joints: string[];
  /** Puts a line into the editor; the number of the line there, null if there is no place for it. */
  onInsert: ((line: string) => number | null) | null;
  onClose: () => void;
}

export function NewChannel({ signal, quantities, joints, onInsert, onClose }: NewChannelProps) {
  const [name, setName] = useState(() => channelName(signal.message, signal.signal));
  const [quantity, setQuantity] = useState(() =>
    likelyQuantity(
      signal.unit,
      quantities.map((one) => one.name),
    ),
  );
  const [joint, setJoint] = useState(joints[0] ?? "");
  const [unit, setUnit] = useState(signal.unit);
  const [said, say] = useState<{ at: number | null } | null>(null);
  const ofJoint = quantities.find((one) => one.name === quantity)?.of_a_joint ?? false;
  const line = channelLine({ name, quantity, joint: ofJoint ? joint : null, unit, source: signal.source ?? {} });
  return (
    <section class="new-channel" aria-label={t("canSignals.newChannel", { signal: signal.signal })}>
      <h3>{t("canSignals.newChannel", { signal: signal.signal })}</h3>
      <div class="new-channel-fields">
        <Field label={t("canSignals.name")}>
          <input value={name} maxLength={80} onInput={(event) => setName(event.currentTarget.value)} />
        </Field>
        <Field label={t("canSignals.quantity")}>
          <select value={quantity} onChange={(event: SelectEvent) => setQuantity(event.currentTarget.value)}>
            {quantities.map((one) => (
              <option key={one.name} value={one.name}>
                {one.name}
              </option>
            ))}
          </select>
        </Field>
        {ofJoint && (
          <Field label={t("canSignals.joint")}>
            <select value={joint} onChange={(event: SelectEvent) => setJoint(event.currentTarget.value)}>
              {joints.map((one) => (
                <option key={one} value={one}>
                  {one}
                </option>
              ))}
            </select>
          </Field>
        )}
        <Field label={t("canSignals.unit")}>
          <input value={unit} maxLength={40} onInput={(event) => setUnit(event.currentTarget.value)} />
        </Field>
      </div>
      <pre class="new-line" role="region" aria-label={t("canSignals.line")} tabIndex={0}>
        {line}
      </pre>
      {said !== null &&
        (said.at === null ? (
          <Notice kind="warning">{t("canSignals.cannotInsert")}</Notice>
        ) : (
          <Notice kind="good">{t("canSignals.inserted", { line: said.at })}</Notice>
        ))}
      <div class="actions">
        {onInsert !== null && (
          <Button
            kind="primary"
            disabled={name.trim() === "" || unit.trim() === "" || said?.at != null}
            onClick={() => say({ at: onInsert(line) })}
          >
            {t("canSignals.insert")}
          </Button>
        )}
        <Button onClick={onClose}>{t("canSignals.close")}</Button>
      </div>
    </section>
  );
}
