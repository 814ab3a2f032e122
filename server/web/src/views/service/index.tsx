/** For admins: who did what, what is told to other systems, and what the service says of itself. */
import { useRoute } from "../../routes";
import { useSession } from "../../session";
import { Notice } from "../../ui/controls";
import { AuditLog } from "./audit_log";
import { LogConsole } from "./log_console";
import { Webhooks } from "./webhooks";
import "./service.css";
import { t } from "../../texts";

const PARTS = [
  ["audit", t("service.auditLog"), AuditLog],
  ["webhooks", t("webhooks.title"), Webhooks],
  ["log", t("service.log"), LogConsole],
] as const;

export default function ServiceView() {
  const session = useSession();
  const [, chosen] = useRoute().path;
  const [name, title, Part] = PARTS.find((part) => part[0] === chosen) ?? PARTS[0];
  const principal = session.principal.value;
  const may = session.may("admin") && principal?.machines == null;
  return (
    <>
      <h1 class="title">{title}</h1>
      <nav class="tabs" aria-label={t("service.partsService")}>
        {PARTS.map(([part, words]) => (
          <a
            key={part}
            class={part === name ? "button current" : "button"}
            href={`#/service/${part}`}
            {...(part === name ? { "aria-current": "page" as const } : {})}
          >
            {words}
          </a>
        ))}
      </nav>
      {may ? <Part /> : <Notice kind="info">{t("service.adminsAllMachines")}</Notice>}
    </>
  );
}
