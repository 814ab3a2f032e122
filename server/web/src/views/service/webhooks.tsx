/** Where messages of this site go, and what became of each: for admins, beside the audit log. */
import { useState } from "preact/hooks";
import type { components } from "../../net/api.gen";
import { query } from "../../net/client";
import { CommandNotice, useCommand } from "../../command";
import { useResource } from "../../resource";
import { useSession } from "../../session";
import { Button, Field, type InputEvent, Mark, Notice, type SelectEvent } from "../../ui/controls";
import { count, DASH, time } from "../../ui/format";
import { Confirm, Empty, Panel, Table } from "../../ui/layout";
import { t } from "../../texts";
import { said } from "../../texts/report";

type Webhook = components["schemas"]["WebhookResource"];
type New = components["schemas"]["NewWebhook"];
type List = components["schemas"]["WebhookList"];
type Delivery = components["schemas"]["DeliveryResource"];
type Deliveries = components["schemas"]["DeliveryList"];

const STATES: Record<Delivery["state"], ["info" | "good" | "bad", string]> = {
  pending: ["info", t("webhooks.underWay")],
  delivered: ["good", t("webhooks.delivered")],
  given_up: ["bad", t("webhooks.givenUp")],
};
const KINDS: Record<Delivery["type"], string> = {
  state: t("webhooks.state"),
  alarm: t("webhooks.alarm"),
  result: t("webhooks.result"),
  test: t("webhooks.test"),
};
const PAGE = 50;

export function Webhooks() {
  const list = useResource<List>("/webhooks?limit=100", "webhooks");
  const items = list.value?.items ?? [];
  return (
    <div class={list.stale ? "stale" : ""}>
      {list.error !== null && <Notice kind="bad">{list.error}</Notice>}
      {list.value !== null && items.length === 0 && <Empty>{t("webhooks.none")}</Empty>}
      {items.map((webhook) => (
        <WebhookPanel key={webhook.id} webhook={webhook} />
      ))}
      <Adding />
    </div>
  );
}

function WebhookPanel({ webhook }: { webhook: Webhook }) {
  const session = useSession();
  const command = useCommand();
  const [asking, setAsking] = useState(false);
  const path = `/webhooks/${encodeURIComponent(webhook.id)}`;
  const away = !session.online.value;
  return (
    <Panel title={webhook.label}>
      <p>
        <code class="detail-cell">{webhook.url}</code>, {webhook.events.map((kind) => KINDS[kind]).join(", ")};{" "}
        {t("webhooks.addedBy", { by: webhook.created_by, created: time(webhook.created) })}
      </p>
      <CommandNotice of={command} />
      <div class="actions">
        <Button
          busy={command.busy}
          disabled={away}
          onClick={() => void command.run({ method: "POST", path: `${path}/test` })}
        >
          {t("webhooks.sendTest")}
        </Button>
        <Button disabled={away} onClick={() => setAsking(true)}>
          {t("webhooks.remove")}
        </Button>
      </div>
      <Messages path={path} />
      {asking && (
        <Confirm
          title={t("webhooks.removeThis", { label: webhook.label })}
          text={t("webhooks.removed")}
          confirm={t("webhooks.remove")}
          kind="danger"
          onNo={() => setAsking(false)}
          onYes={() => {
            setAsking(false);
            void command.run({ method: "DELETE", path });
          }}
        />
      )}
    </Panel>
  );
}

/** Messages to one webhook, newest first, a page at a time. */
function Messages({ path }: { path: string }) {
  const [state, setState] = useState("");
  const [cursors, setCursors] = useState<number[]>([0]);
  const at = cursors[cursors.length - 1] ?? 0;
  const asked = `${path}/deliveries${query({ limit: PAGE, state, cursor: at || null })}`;
  const list = useResource<Deliveries>(asked, "webhook_deliveries");
  const items = list.value?.items ?? [];
  const next = list.value?.next ?? null;
  return (
    <>
      <Field label={t("common.state")}>
        <select
          value={state}
          onChange={(event: SelectEvent) => {
            setState(event.currentTarget.value);
            setCursors([0]);
          }}
        >
          <option value="">{t("service.everything")}</option>
          {Object.entries(STATES).map(([value, [, words]]) => (
            <option key={value} value={value}>
              {words}
            </option>
          ))}
        </select>
      </Field>
      {list.error !== null && <Notice kind="bad">{list.error}</Notice>}
      {list.value !== null && items.length === 0 && <Empty>{t("webhooks.noMessage")}</Empty>}
      {items.length > 0 && (
        <Table
          caption={t("webhooks.messages")}
          columns={[
            { name: "created", title: t("common.when") },
            { name: "type", title: t("service.what") },
            { name: "state", title: t("common.state") },
            { name: "tries", title: t("webhooks.tries"), align: "right" },
            { name: "error", title: t("webhooks.lastTry") },
          ]}
          rows={items.map((own) => ({
            key: own.id,
            created: time(own.created),
            type: KINDS[own.type],
            state: <Mark kind={STATES[own.state][0]}>{STATES[own.state][1]}</Mark>,
            tries: count(own.tries),
            error: <span class="detail-cell">{own.error === null ? DASH : said(own.error, own.error_message)}</span>,
          }))}
        />
      )}
      <div class="actions">
        {cursors.length > 1 && <Button onClick={() => setCursors(cursors.slice(0, -1))}>{t("service.newer")}</Button>}
        {next !== null && <Button onClick={() => setCursors([...cursors, next])}>{t("service.older")}</Button>}
      </div>
    </>
  );
}

function Adding() {
  const session = useSession();
  const command = useCommand();
  const [url, setUrl] = useState("");
  const [label, setLabel] = useState("");
  const [made, setMade] = useState<New | null>(null);
  return (
    <Panel title={t("webhooks.add")}>
      <p class="hint">{t("webhooks.places")}</p>
      <div class="filters">
        <Field label={t("webhooks.address")}>
          <input
            type="url"
            value={url}
            maxLength={500}
            onInput={(event: InputEvent) => setUrl(event.currentTarget.value)}
          />
        </Field>
        <Field label={t("webhooks.label")}>
          <input value={label} maxLength={80} onInput={(event: InputEvent) => setLabel(event.currentTarget.value)} />
        </Field>
        <Button
          busy={command.busy}
          disabled={url === "" || !session.online.value}
          onClick={() =>
            void command.run<New>({ method: "POST", path: "/webhooks", json: { url, label } }, (added) => {
              setMade(added);
              setUrl("");
              setLabel("");
            })
          }
        >
          {t("webhooks.add")}
        </Button>
      </div>
      <CommandNotice of={command} />
      {made !== null && (
        <Notice kind="good">
          {t("webhooks.secretOnce", { label: made.label })} <code class="detail-cell">{made.secret}</code>
        </Notice>
      )}
    </Panel>
  );
}
