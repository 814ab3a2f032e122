/** Where one can go: a bar at the bottom of an upright tablet, a rail at the side of a wide screen. */
import { useEffect, useRef, useState } from "preact/hooks";
import { useRoute } from "../routes";
import { useSession } from "../session";
import { Icon, type IconName } from "../ui/icons";
import { t } from "../texts";

interface Place {
  name: string;
  title: string;
  icon: IconName;
}
const MAIN: Place[] = [
  { name: "live", title: t("shell.live"), icon: "live" },
  { name: "alarms", title: t("common.alarms"), icon: "alarm" },
  { name: "recalibrate", title: t("common.recalibrate"), icon: "recalibrate" },
  { name: "results", title: t("common.results"), icon: "result" },
];
const MORE: Place[] = [
  { name: "pose", title: t("common.pose"), icon: "pose" },
  { name: "recordings", title: t("shell.recordingsShort"), icon: "recording" },
  { name: "jobs", title: t("common.jobs"), icon: "job" },
  { name: "valves", title: t("shell.valves"), icon: "valve" },
  { name: "calibrations", title: t("shell.calibrationsShort"), icon: "calibration" },
  { name: "history", title: t("shell.history"), icon: "history" },
  { name: "schedules", title: t("common.schedules"), icon: "schedule" },
  { name: "machines", title: t("common.machines"), icon: "machine" },
  { name: "fleet", title: t("common.fleet"), icon: "fleet" },
];
/** What only an admin may look at. */
const ADMIN: Place[] = [{ name: "service", title: t("shell.service"), icon: "service" }];

export function Navigation({ at }: { at: string }) {
  const [open, setOpen] = useState(false);
  const route = useRoute();
  const box = useRef<HTMLElement>(null);
  useEffect(() => setOpen(false), [route]);
  useEffect(() => {
    if (!open) return undefined;
    const close = (event: Event): void => {
      const away =
        event instanceof KeyboardEvent ? event.key === "Escape" : !box.current?.contains(event.target as Node);
      if (away) setOpen(false);
    };
    document.addEventListener("keydown", close);
    document.addEventListener("pointerdown", close);
    return () => {
      document.removeEventListener("keydown", close);
      document.removeEventListener("pointerdown", close);
    };
  }, [open]);
  const places = useSession().may("admin") ? [...MORE, ...ADMIN] : MORE;
  const further = places.some((place) => place.name === at);
  return (
    <nav class="navigation" aria-label={t("shell.main")} ref={box}>
      <ul>
        {MAIN.map((place) => (
          <li key={place.name}>
            <Link place={place} at={at} />
          </li>
        ))}
        <li class="more">
          <button
            type="button"
            class={further ? "current" : ""}
            aria-expanded={open}
            aria-controls="more-places"
            onClick={() => setOpen(!open)}
          >
            <Icon name="more" />
            <span>{t("shell.more")}</span>
          </button>
        </li>
      </ul>
      <ul id="more-places" class={open ? "further open" : "further"}>
        {places.map((place) => (
          <li key={place.name}>
            <Link place={place} at={at} />
          </li>
        ))}
      </ul>
    </nav>
  );
}

function Link({ place, at }: { place: Place; at: string }) {
  const here = place.name === at;
  return (
    <a href={`#/${place.name}`} class={here ? "current" : ""} {...(here ? { "aria-current": "page" as const } : {})}>
      <Icon name={place.icon} />
      <span>{place.title}</span>
    </a>
  );
}
