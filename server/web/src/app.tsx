/** The page around all views: where to go, who is there, what is wrong. */
import { useEffect, useRef } from "preact/hooks";
import { AlarmBanner } from "./shell/alarm_banner";
import { Header } from "./shell/header";
import { Navigation } from "./shell/navigation";
import { Connectivity } from "./shell/connectivity";
import { pairingCode, useRoute } from "./routes";
import { useSession } from "./session";
import Alarms from "./views/alarms";
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

const VIEWS = {
  live: [Live, "Live"],
  alarms: [Alarms, "Alarms"],
  recalibrate: [Recalibrate, "Recalibrate"],
  recordings: [Recordings, "Recordings"],
  jobs: [Jobs, "Jobs"],
  results: [Results, "Results"],
  calibrations: [Calibrations, "Calibrations"],
  schedules: [Schedules, "Schedules"],
  machines: [Machines, "Machines"],
  pose: [Pose, "Pose"],
  history: [History, "History"],
  fleet: [Fleet, "Fleet"],
  service: [Service, "Service"],
  pair: [Pair, "Pair this device"],
} as const;

export function App() {
  const session = useSession();
  const route = useRoute();
  const name = route.path[0] ?? "live";
  const [View, title] = VIEWS[name as keyof typeof VIEWS] ?? [NotFound, "Not found"];
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
        <p role="status">Waiting for the service …</p>
      </main>
    );
  return (
    <>
      <a class="skip" href="#content" onClick={(event) => (event.preventDefault(), content.current?.focus())}>
        Skip to the content
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
      <h1>Not found</h1>
      <p>
        There is no such page. <a href="#/live">Go to the live signals</a>
      </p>
    </>
  );
}
