/** Says when the service is away, since when, and that what is shown is old. */
import { useEffect, useState } from "preact/hooks";
import { useSession } from "../session";
import { Notice } from "../ui/controls";
import { duration } from "../ui/format";
import { t } from "../texts";

export function Connectivity() {
  const { online } = useSession();
  const [since, setSince] = useState<number | null>(null);
  const [now, setNow] = useState(Date.now());
  const away = !online.value;
  useEffect(() => {
    if (!away) {
      setSince(null);
      return undefined;
    }
    const start = Date.now();
    setSince(start);
    setNow(start);
    const timer = setInterval(() => setNow(Date.now()), 1000);
    return () => clearInterval(timer);
  }, [away]);
  if (since === null || now - since < 1500) return null; // waking and reconnecting takes a moment
  return (
    <div class="connectivity">
      <Notice kind="warning">
        {t("shell.noConnectionService")} <span aria-hidden="true">{duration((now - since) / 1000)}</span>
        <span class="for-reader">{t("shell.aWhile")}</span>
        {t("shell.whatShownOldPage")}
      </Notice>
    </div>
  );
}
