/** The page around all views: where to go, who is there, what is wrong. */
import { useEffect, useRef } from "preact/hooks";
import { AlarmBanner } from "./shell/alarm_banner";
import { Header } from "./shell/header";
import { Navigation } from "./shell/navigation";
import { Connectivity } from "./shell/connectivity";
import { pairingCode, useRoute } from "./routes";
import { useSession } from "./session";
import Alarms from "./views/alarms";
import BusCheck from "./views/bus_check";
import Calibrations from "./views/calibrations";
import Fleet from "./views/fleet";
import History from "./views/history";
import Jobs from "./views/jobs";
import Live from "./views/live";
import Machines from "./views/machines";
import Pair from "./views/pair";
import Pose from "./views/pose";
import Recalibrate from "./views/recalibrate";
import Recordings from "./views/recordings";
import Results from "./views/results";
import Schedules from "./views/schedules";
import Service from "./views/service";
import { t } from "./texts";

const VIEWS = {
  live: [Live, t("shell.live")],
  alarms: [Alarms, t("common.alarms")],
  recalibrate: [Recalibrate, t("common.recalibrate")],
  recordings: [Recordings, t("common.recordings")],
  jobs: [Jobs, t("common.jobs")],
  results: [Results, t("common.results")],
  calibrations: [Calibrations, t("common.calibrations")],
  schedules: [Schedules, t("common.schedules")],
  machines: [Machines, t("common.machines")],
  "bus-check": [BusCheck, t("busCheck.title")],
  pose: [Pose, t("common.pose")],
  history: [History, t("shell.history")],
  fleet: [Fleet, t("common.fleet")],
  service: [Service, t("shell.service")],
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
