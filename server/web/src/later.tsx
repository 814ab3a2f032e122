/**
 * Views that come after the first one: each is a file of its own, fetched when it is opened or once the page is at rest.
 *
 * A page that is kept open all day has all of them before its network may go; one that could not be fetched is tried
 * again when it is opened. Where the service was upgraded meanwhile, its files of the old version are gone: the page says
 * so and offers to be loaded again. It does not do that by itself, as an upload may be under way.
 */
import type { ComponentType } from "preact";
import { useEffect, useState } from "preact/hooks";
import { Button, Notice } from "./ui/controls";
import { t } from "./texts";

type Fetched<P> = () => Promise<{ default: ComponentType<P> }>;

/** Milliseconds after the start in which nothing else is fetched. */
const QUIET_MS = 4000;
const waiting: (() => Promise<unknown>)[] = [];

/** Whether the service has another version of this page by now: its first script has another name. */
async function upgraded(): Promise<boolean> {
  const own = document.querySelector('script[type="module"][src]')?.getAttribute("src")?.split("/").pop();
  if (own === undefined) return false;
  try {
    const answer = await fetch("./index.html", { cache: "no-store" });
    return answer.ok && !(await answer.text()).includes(own);
  } catch {
    return false;
  }
}

/** A view, or a part of one, that is fetched when it is shown, or before: by its `fetch`, or by `fetchViews`. */
export function later<P extends object = object>(
  fetched: Fetched<P>,
): ComponentType<P> & { fetch: () => Promise<unknown> } {
  let View: ComponentType<P> | null = null;
  const come = async () => {
    View ??= (await fetched()).default;
    return View;
  };
  waiting.push(come);
  function Later(props: P) {
    const [state, setState] = useState<ComponentType<P> | "coming" | "failed" | "upgraded">(() => View ?? "coming");
    useEffect(() => {
      let here = true;
      if (state === "coming")
        come().then(
          (found) => here && setState(() => found),
          async () => {
            const found = (await upgraded()) ? "upgraded" : "failed";
            if (here) setState(found);
          },
        );
      return () => {
        here = false;
      };
    }, [state]);
    if (state === "failed")
      return (
        <>
          <Notice kind="bad">{t("common.serviceDidNotAnswer")}</Notice>
          <Button onClick={() => setState("coming")}>{t("shell.tryAgain")}</Button>
        </>
      );
    if (state === "upgraded")
      return (
        <>
          <Notice kind="warning">{t("shell.serviceWasUpgraded")}</Notice>
          <Button kind="primary" onClick={() => location.reload()}>
            {t("shell.loadPageAgain")}
          </Button>
        </>
      );
    if (state === "coming") return <p role="status">{t("common.reading")}</p>;
    const Shown = state;
    return <Shown {...props} />;
  }
  return Object.assign(Later, { fetch: come });
}

/** Fetch all views, one after the other, once the first has had its time. */
export function fetchViews(): void {
  setTimeout(() => {
    void (async () => {
      for (const come of waiting) await come().catch(() => undefined);
    })();
  }, QUIET_MS);
}
