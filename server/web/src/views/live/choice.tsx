/** What a person chose to see of a machine: which plots and channels, which thresholds; kept on this device. */
import { useState } from "preact/hooks";
import { remember, remembered } from "../../storage";
import { Button, Field, type InputEvent, type SelectEvent } from "../../ui/controls";
import type { Group } from "./groups";
import { t } from "../../texts";
import { number } from "../../ui/format";

export interface Choice {
  /** Names of lines that are not drawn. */
  hidden: string[];
  /** Thresholds by key of the plot. */
  thresholds: Record<string, number[]>;
}
const NOTHING: Choice = { hidden: [], thresholds: {} };
const key = (machine: string): string => `hilfit.plots.${machine}`;

export function readChoice(text: string | null): Choice {
  try {
    const found = JSON.parse(text ?? "null") as Partial<Choice> | null;
    const thresholds = Object.entries(found?.thresholds ?? {}).map(([title, values]) => [
      title,
      Array.isArray(values) ? values.filter((value) => Number.isFinite(value)) : [],
    ]);
    return {
      hidden: Array.isArray(found?.hidden) ? found.hidden.filter((name) => typeof name === "string") : [],
      thresholds: Object.fromEntries(thresholds) as Record<string, number[]>,
    };
  } catch {
    return NOTHING;
  }
}

export function useChoice(machine: string): [Choice, (choice: Choice) => void] {
  const [choice, setChoice] = useState(() => readChoice(remembered(key(machine))));
  return [
    choice,
    (next) => {
      remember(key(machine), JSON.stringify(next));
      setChoice(next);
    },
  ];
}

/** The groups with the lines that are to be drawn; groups without any are left out. */
export function chosen(groups: Group[], hidden: string[]): Group[] {
  return groups
    .map((group) => ({ ...group, lines: group.lines.filter((line) => !hidden.includes(line.name)) }))
    .filter((group) => group.lines.length > 0);
}

interface ChoiceProps {
  groups: Group[];
  choice: Choice;
  onChoice: (choice: Choice) => void;
}

export function ChannelChoice({ groups, choice, onChoice }: ChoiceProps) {
  const toggle = (names: string[], show: boolean): void => {
    const others = choice.hidden.filter((name) => !names.includes(name));
    onChoice({ ...choice, hidden: show ? others : [...others, ...names] });
  };
  return (
    <div class="channel-choice">
      {groups.map((group) => {
        const names = group.lines.map((line) => line.name);
        const all = names.every((name) => !choice.hidden.includes(name));
        return (
          <fieldset key={group.title}>
            <legend>
              {group.title} <span class="unit">{group.unit}</span>
            </legend>
            {names.length > 1 && (
              <label class="check">
                <input type="checkbox" checked={all} onChange={() => toggle(names, !all)} /> {t("live.all")}
              </label>
            )}
            {group.lines.map((line) => (
              <label key={line.name} class="check">
                <input
                  type="checkbox"
                  checked={!choice.hidden.includes(line.name)}
                  onChange={() => toggle([line.name], choice.hidden.includes(line.name))}
                />{" "}
                {line.label}
              </label>
            ))}
          </fieldset>
        );
      })}
    </div>
  );
}

export function Thresholds({ groups, choice, onChoice }: ChoiceProps) {
  const [plot, setPlot] = useState(groups[0]?.key ?? "");
  const [text, setText] = useState("");
  const value = Number(text.replace(",", ".").replace("−", "-"));
  const good = text.trim() !== "" && Number.isFinite(value);
  const group = groups.find((one) => one.key === plot) ?? groups[0];
  const set = (of: string, values: number[]): void =>
    onChoice({ ...choice, thresholds: { ...choice.thresholds, [of]: values } });
  const titles = new Map(groups.map((one) => [one.key, one.title]));
  if (group === undefined) return null;
  return (
    <>
      <form
        class="record-form"
        onSubmit={(event) => {
          event.preventDefault();
          if (!good) return;
          set(group.key, [...(choice.thresholds[group.key] ?? []), value]);
          setText("");
        }}
      >
        <Field label={t("live.plot")}>
          <select value={group.key} onChange={(event: SelectEvent) => setPlot(event.currentTarget.value)}>
            {groups.map((one) => (
              <option key={one.key} value={one.key}>
                {one.title}
              </option>
            ))}
          </select>
        </Field>
        <Field label={t("live.lineAt", { unit: group.unit })}>
          <input
            value={text}
            inputMode="decimal"
            autocomplete="off"
            onInput={(event: InputEvent) => setText(event.currentTarget.value)}
          />
        </Field>
        <Button type="submit" disabled={!good}>
          {t("live.addALine")}
        </Button>
      </form>
      <ul class="threshold-list">
        {Object.entries(choice.thresholds).flatMap(([of, values]) =>
          values.map((one, index) => (
            <li key={`${of} ${index}`}>
              {titles.get(of) ?? of}: {number(one)}{" "}
              <Button
                label={t("live.removeLineAt", { one: number(one), of: titles.get(of) ?? of })}
                onClick={() =>
                  set(
                    of,
                    values.filter((_, other) => other !== index),
                  )
                }
              >
                {t("live.remove")}
              </Button>
            </li>
          )),
        )}
      </ul>
      <p class="hint">{t("live.endsRangeChannelAs")}</p>
    </>
  );
}
