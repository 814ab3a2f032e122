/** Every device and channel of a machine that is being acquired, looked at while it stands still: one page to print. */
import { useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { useResource } from "../../resource";
import { useRoute } from "../../routes";
import { useSession } from "../../session";
import { Button, Mark, Notice } from "../../ui/controls";
import { DASH, fixed, number, percent, withStd } from "../../ui/format";
import { Panel, Table } from "../../ui/layout";
import "./bus_check.css";
import { t } from "../../texts";
import { said } from "../../texts/report";

type Check = components["schemas"]["BusCheck"];
type Device = components["schemas"]["CheckedDevice"];
type Channel = components["schemas"]["CheckedChannel"];
type Delay = components["schemas"]["CheckedDelay"];

/** Share of the cycles below which a channel does not come as it should. */
const LEAST_SHARE = 0.99;

export default function BusCheckView() {
  const session = useSession();
  const { path } = useRoute();
  const machine = path[1] ?? session.machine.value;
  const [depressurised, setDepressurised] = useState(false);
  const address =
    machine === null ? null : `/machines/${encodeURIComponent(machine)}/bus-check?depressurised=${depressurised}`;
  const check = useResource<Check>(address, ["acquisition"]);
  const found = check.value;
  return (
    <div class={`bus-check${check.stale ? " stale" : ""}`}>
      <h1 class="title">{machine === null ? t("busCheck.title") : t("busCheck.of", { machine })}</h1>
      <div class="not-printed">
        <p class="hint">{t("busCheck.hint")}</p>
        <label class="check">
          <input
            type="checkbox"
            checked={depressurised}
            onChange={(event) => setDepressurised(event.currentTarget.checked)}
          />{" "}
          {t("busCheck.depressurised")}
        </label>
        <div class="actions">
          <Button kind="primary" busy={check.loading} onClick={check.reload}>
            {t("busCheck.again")}
          </Button>
          <Button disabled={found === null} onClick={() => window.print()}>
            {t("busCheck.print")}
          </Button>
        </div>
      </div>
      {check.error !== null && <Notice kind="bad">{check.error}</Notice>}
      {found === null && check.loading && <p role="status">{t("busCheck.reading")}</p>}
      {found !== null && <Found check={found} depressurised={depressurised} />}
      {machine !== null && (
        <p class="not-printed">
          <a href={`#/machines/${encodeURIComponent(machine)}`}>{t("busCheck.back")}</a>
        </p>
      )}
    </div>
  );
}

function Found({ check, depressurised }: { check: Check; depressurised: boolean }) {
  return (
    <>
      <p class="hint">
        {t("busCheck.looked", { utc: check.utc, seconds: number(check.seconds), rate: number(check.rate_hz) })}
        {t("busCheck.cycles", { skipped: number(check.skipped), late: fixed(check.worst_late_ms, 1) })}
        {depressurised && t("busCheck.depressurisedShort")}
      </p>
      <Panel title={t("busCheck.toLookAt")}>
        {check.findings.length === 0 ? (
          <Mark kind="good">{t("busCheck.nothing")}</Mark>
        ) : (
          <ul class="findings">
            {check.findings.map((line) => (
              <li key={line}>{said(line, check.messages[line])}</li>
            ))}
          </ul>
        )}
        {check.notes.map((line) => (
          <p key={line} class="hint">
            {said(line, check.messages[line])}
          </p>
        ))}
      </Panel>
      <Panel title={t("busCheck.devices")}>
        <Table
          caption={t("busCheck.devices")}
          columns={[
            { name: "device", title: t("busCheck.busDevice") },
            { name: "state", title: t("busCheck.state") },
            { name: "identity", title: t("busCheck.identity") },
            { name: "mapping", title: t("busCheck.mapping") },
            { name: "latency", title: t("busCheck.latency"), align: "right" },
            { name: "jitter", title: t("busCheck.jitter"), align: "right" },
          ]}
          rows={check.devices.map((device) => ({
            key: `${device.bus} ${device.device}`,
            device: `${device.bus} ${device.device}`,
            state: <Mark kind={device.state === "running" ? "good" : "bad"}>{stateOf(device)}</Mark>,
            identity: identityOf(device),
            mapping: device.mapping,
            latency: fixed(device.latency_ms, 2),
            jitter: fixed(device.jitter_ms, 2),
          }))}
        />
      </Panel>
      <Panel title={t("busCheck.channels")}>
        <Channels channels={check.channels} />
      </Panel>
      {new Set(check.channels.map(({ bus }) => bus)).size > 1 && (
        <Panel title={t("busCheck.delays")}>
          {check.delays.length === 0 ? <p class="hint">{t("busCheck.noDelays")}</p> : <Delays delays={check.delays} />}
        </Panel>
      )}
      <p class="signed" aria-hidden="true">
        <span>{t("busCheck.checkedBy")}</span>
        <span>{t("busCheck.date")}</span>
        <span>{t("busCheck.place")}</span>
      </p>
    </>
  );
}

function Channels({ channels }: { channels: Channel[] }) {
  return (
    <Table
      caption={t("busCheck.channels")}
      columns={[
        { name: "name", title: t("busCheck.channel") },
        { name: "device", title: t("busCheck.busDevice") },
        { name: "value", title: t("busCheck.value"), align: "right" },
        { name: "raw", title: t("busCheck.raw"), align: "right" },
        { name: "noise", title: t("busCheck.noise"), align: "right" },
        { name: "step", title: t("busCheck.step"), align: "right" },
        { name: "drift", title: t("busCheck.drift"), align: "right" },
        { name: "age", title: t("busCheck.age"), align: "right" },
        { name: "jitter", title: t("busCheck.jitter"), align: "right" },
        { name: "share", title: t("busCheck.share"), align: "right" },
      ]}
      rows={channels.map((channel) => ({
        key: channel.name,
        name: channel.name,
        device: `${channel.bus} ${channel.device}`,
        value: channel.value === null ? DASH : `${number(channel.value)} ${channel.unit}`,
        raw: number(channel.raw, 7),
        noise: number(channel.noise, 2),
        step: number(channel.step, 2),
        drift: driftOf(channel),
        age: number(channel.age_ms, 3),
        jitter: number(channel.jitter_ms, 2),
        share:
          channel.share < LEAST_SHARE ? <Mark kind="bad">{percent(channel.share, 1)}</Mark> : percent(channel.share, 1),
      }))}
    />
  );
}

function Delays({ delays }: { delays: Delay[] }) {
  return (
    <Table
      caption={t("busCheck.delays")}
      columns={[
        { name: "bus", title: t("busCheck.bus") },
        { name: "reference", title: t("busCheck.behind") },
        { name: "delay", title: t("busCheck.by"), align: "right" },
        { name: "pairs", title: t("busCheck.toldBy") },
      ]}
      rows={delays.map((delay) => ({
        key: `${delay.bus} ${delay.reference}`,
        bus: delay.bus,
        reference: delay.reference,
        delay: withStd(delay.delay_ms, delay.std_ms),
        pairs: delay.told_by.map(toldBy).join("; "),
      }))}
    />
  );
}

function toldBy({ joint, kind, delay_ms, std_ms }: Delay["told_by"][number]): string {
  const delay = withStd(delay_ms, std_ms);
  return kind === "position" ? t("busCheck.position", { joint, delay }) : t("busCheck.effort", { joint, delay });
}

function stateOf({ state }: Device): string {
  switch (state) {
    case "running":
      return t("busCheck.running");
    case "commissioning":
      return t("busCheck.commissioning");
    case "silent":
      return t("busCheck.silent");
    case "failed":
      return t("busCheck.failed");
    default:
      return state;
  }
}

/** Name, serial number and firmware of a device that was asked. */
export function identityOf(device: Device): string {
  const { identity } = device;
  const serial = identity["serial number"];
  const parts = [
    identity.device ?? identity.profile,
    serial === undefined ? undefined : t("busCheck.serial", { number: serial }),
    identity.firmware === undefined ? undefined : t("busCheck.firmware", { version: identity.firmware }),
  ];
  return parts.filter((part) => part !== undefined).join(", ") || DASH;
}

/** Change per minute with its deviation; a channel that moves has none. */
export function driftOf(channel: Channel): string {
  return channel.moved ? t("busCheck.moves") : withStd(channel.drift, channel.drift_std);
}
