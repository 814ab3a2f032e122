/** What is said beside a recording: what the checks find in it, what happened meanwhile, and its spectrum. */
import { useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { useResource } from "../../resource";
import { Field, Mark, Notice, type SelectEvent } from "../../ui/controls";
import { duration, fixed, number } from "../../ui/format";
import { Table } from "../../ui/layout";
import { Plot } from "../../ui/plot";
import { t } from "../../texts";
import type { Message } from "../../texts/message";
import { said } from "../../texts/report";

type Remarks = components["schemas"]["RecordingRemarks"];
type Spectrum = components["schemas"]["Spectrum"];

const text = (value: unknown): string => (typeof value === "string" ? value : "");

export function Findings({ remarks }: { remarks: Remarks }) {
  if (remarks.findings.length === 0)
    return (
      <p>
        <Mark kind="good">{t("recordings.checksFindNothingWrong")}</Mark>
      </p>
    );
  return (
    <ul class="plain-list">
      {remarks.findings.map((finding, index) => (
        <li key={index}>
          <Notice kind={finding.severity === "note" ? "info" : "warning"}>
            {said(text(finding.text), finding.text_message as Message | null)}{" "}
            <strong>{said(text(finding.cure), finding.cure_message as Message | null)}</strong>
          </Notice>
        </li>
      ))}
    </ul>
  );
}

export function Events({ remarks }: { remarks: Remarks }) {
  if (remarks.events.length === 0) return <p class="hint">{t("recordings.noEventsDevicesBuses")}</p>;
  return (
    <Table
      caption={t("recordings.whatHappenedWhileWas")}
      columns={[
        { name: "time", title: t("recordings.at"), align: "right" },
        { name: "device", title: t("common.device") },
        { name: "text", title: t("recordings.what") },
        { name: "seconds", title: t("recordings.lasted"), align: "right" },
        { name: "count", title: t("recordings.times"), align: "right" },
      ]}
      rows={remarks.events.map((event, index) => ({
        key: String(index),
        time: event.time === null ? "–" : `${fixed(event.time, 1)} s`,
        device: event.device,
        text: said(event.text, event.text_message),
        seconds: event.seconds === null ? t("recordings.untilItsEnd") : duration(event.seconds),
        count: String(event.count),
      }))}
    />
  );
}

/** Power spectral density in decibels over frequency, of a channel that is chosen. */
export function SpectrumPlot({ id, channels }: { id: string; channels: string[] }) {
  const [channel, setChannel] = useState(channels[0] ?? "");
  const path = `/recordings/${encodeURIComponent(id)}/spectrum?channel=${encodeURIComponent(channel)}`;
  const found = useResource<Spectrum>(channel === "" ? null : path, []);
  const spectrum = found.value;
  return (
    <>
      <Field label={t("recordings.channel")}>
        <select value={channel} onChange={(event: SelectEvent) => setChannel(event.currentTarget.value)}>
          {channels.map((name) => (
            <option key={name}>{name}</option>
          ))}
        </select>
      </Field>
      {found.error !== null && <Notice kind="warning">{found.error}</Notice>}
      {spectrum !== null && (
        <>
          <Plot
            title={t("recordings.spectrumOf", { channel: spectrum.channel })}
            unit={t("common.db1Hz", { unit: spectrum.unit })}
            x={{ label: t("common.frequencyHz"), values: spectrum.frequency }}
            series={[{ label: t("recordings.powerDensity"), values: spectrum.density.map(decibels) }]}
          />
          <p class="hint">{t("recordings.powerDensityWelchsMethod", { seconds: number(spectrum.seconds, 3) })}</p>
        </>
      )}
    </>
  );
}

export function decibels(power: number): number | null {
  return power > 0 ? 10 * Math.log10(power) : null;
}
