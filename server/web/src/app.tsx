/** The page around all views: where to go, who is there, what is wrong. */
import { useEffect, useRef } from "preact/hooks";
import { AlarmBanner } from "./shell/alarm_banner";
import { Header } from "./shell/header";
import { Navigation } from "./shell/navigation";
import { Connectivity } from "./shell/connectivity";
import { pairingCode, useRoute } from "./routes";
import { useSession } from "./session";
import { later } from "./later";
import Live from "./views/live";
import Pair from "./views/pair";
import { t } from "./texts";

const VIEWS = {
  live: [Live, t("shell.live")],
  alarms: [later(() => import("./views/alarms")), t("common.alarms")],
  recalibrate: [later(() => import("./views/recalibrate")), t("common.recalibrate")],
  recordings: [later(() => import("./views/recordings")), t("common.recordings")],
  jobs: [later(() => import("./views/jobs")), t("common.jobs")],
  results: [later(() => import("./views/results")), t("common.results")],
  valves: [later(() => import("./views/valves")), t("shell.valves")],
  calibrations: [later(() => import("./views/calibrations")), t("common.calibrations")],
  schedules: [later(() => import("./views/schedules")), t("common.schedules")],
  machines: [later(() => import("./views/machines")), t("common.machines")],
  "bus-check": [later(() => import("./views/bus_check")), t("busCheck.title")],
  pose: [later(() => import("./views/pose")), t("common.pose")],
  history: [later(() => import("./views/history")), t("shell.history")],
  fleet: [later(() => import("./views/fleet")), t("common.fleet")],
  service: [later(() => import("./views/service")), t("shell.service")],
  pair: [Pair, t("common.pairThisDevice")],
} as const;

export function App() {
  const session = useSession();
  const route = useRoute();
  const name = route.path[0] ?? "live";
  const [View, title] = VIEWS[name as keyof typeof VIEWS] ?? [NotFound, t("shell.notFound")];
  const content = useRef<HTMLElement>(null);
  const first = useRef(true);
  useEffect(() => {
    document.title = `${title} – hilfit`;
    if (first.current) first.current = false;
    else content.current?.focus(); // who reads by ear is told of the new page
    window.scrollTo(0, 0);
  }, [route.path.join("/"), title]);

  if (session.access.value === "stranger" || pairingCode(location.hash) !== null)
    return (
      <main id="content" class="alone">
        <Pair />
      </main>
    );
  if (session.access.value === "unknown")
    return (
      <main id="content" class="alone">
        <h1>hilfit</h1>
        <p role="status">{t("shell.waitingService")}</p>
      </main>
    );
  return (
    <>
      <a class="skip" href="#content" onClick={(event) => (event.preventDefault(), content.current?.focus())}>
        {t("shell.skipContent")}
      </a>
      <Header />
      <Navigation at={name} />
      <main id="content" ref={content} tabIndex={-1} aria-label={title}>
        <Connectivity />
        <AlarmBanner />
        <View key={name} />
      </main>
    </>
  );
}

function NotFound() {
  return (
    <>
      <h1>{t("shell.notFound")}</h1>
      <p>
        {t("shell.thereNoSuchPage")} <a href="#/live">{t("shell.goLiveSignals")}</a>
      </p>
    </>
  );
}
