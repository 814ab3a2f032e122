/** Which machine is looked at, who looks, and how bright. */
import { useSession } from "../session";
import type { SelectEvent } from "../ui/controls";
import { Icon } from "../ui/icons";
import { switchTheme, theme } from "../ui/theme";
import { accessWords } from "../words";
import { LANGUAGES, type Language, chooseLanguage, language } from "../texts/language";
import { t } from "../texts";

export function Header() {
  const session = useSession();
  const machines = session.machines.value;
  const principal = session.principal.value;
  const dark = theme.value === "dark";
  return (
    <header class="header">
      <a class="brand" href="#/live">
        hilfit
      </a>
      {machines.length > 0 && (
        <label class="machine-choice">
          <span class="for-reader">{t("common.machine")}</span>
          <select
            value={session.machine.value ?? ""}
            onChange={(event: SelectEvent) => session.choose(event.currentTarget.value)}
          >
            {machines.map((machine) => (
              <option key={machine.name} value={machine.name}>
                {machine.name}
              </option>
            ))}
          </select>
        </label>
      )}
      <span class="fill" />
      {principal !== null && (
        <a
          class="who"
          href="#/pair"
          aria-label={t("shell.signedInAs", { name: principal.name, role: accessWords(principal.role) })}
        >
          <span>{principal.kind === "local" ? t("shell.thisComputer") : principal.name}</span>
          <span class="role">{accessWords(principal.role)}</span>
        </a>
      )}
      <label class="language-choice">
        <span class="for-reader">{t("common.language")}</span>
        <select
          value={language}
          disabled={!session.online.value}
          onChange={(event: SelectEvent) => chooseLanguage(event.currentTarget.value as Language)}
        >
          {Object.entries(LANGUAGES).map(([name, title]) => (
            <option key={name} value={name} lang={name} aria-label={title}>
              {name.toUpperCase()}
            </option>
          ))}
        </select>
      </label>
      <button
        type="button"
        class="icon-button"
        aria-label={dark ? t("shell.lightColours") : t("shell.darkColours")}
        onClick={switchTheme}
      >
        <Icon name={dark ? "sun" : "moon"} />
      </button>
    </header>
  );
}
