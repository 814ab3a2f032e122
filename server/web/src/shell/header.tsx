/** Which machine is looked at, who looks, and how bright. */
import { useSession } from "../session";
import type { SelectEvent } from "../ui/controls";
import { Icon } from "../ui/icons";
import { switchTheme, theme } from "../ui/theme";

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
          <span class="for-reader">Machine</span>
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
        <a class="who" href="#/pair" aria-label={`Signed in as ${principal.name}, ${principal.role}`}>
          <span>{principal.kind === "local" ? "this computer" : principal.name}</span>
          <span class="role">{principal.role}</span>
        </a>
      )}
      <button
        type="button"
        class="icon-button"
        aria-label={dark ? "Light colours" : "Dark colours"}
        onClick={switchTheme}
      >
        <Icon name={dark ? "sun" : "moon"} />
      </button>
    </header>
  );
}
