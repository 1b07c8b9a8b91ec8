#pragma once
/// Typed access to a TOML table that checks every value against the key table and names file, line and key.

#include <fmt/format.h>
#include <toml++/toml.h>
#include <array>
#include <memory>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <vector>

#include "host_sim/error.hpp"
#include "host_sim/names.hpp"
#include "host_sim/scene/key.hpp"
#include "host_sim/scene/toml_text.hpp"

namespace esmc::host {

struct Scene;
/// Reads a scene from a parsed table, with the checks and errors of read_scene; `file`: its name in errors.
Scene read_scene_table(toml::table table, const std::string& file);

/// A table being read. `schema` is the prefix of its keys in the key table. Read every key, then call
/// finish(). Every reading function notes an error for a value that the key table does not allow, and for an
/// absent key without a default, and gives a stand-in: once all of the file is read, see errors(). An absent
/// key with a default gives it; optional_ functions give none, whether or not there is a default. A key whose
/// default is "-" is for those, or for functions that say "None" or state a default. A key that the key table
/// does not have is a std::logic_error. The TOML table and `keys` must outlive the Section.
class Section {
 public:
  /// `file`, `name`: for messages; `errors`: the list of the root, null for the root itself.
  Section(const toml::table& table, std::string file, std::string name, std::string schema,
          std::span<const Key> keys = scene_keys(),
          std::shared_ptr<std::vector<std::string>> errors = nullptr)
      : errors_(errors ? std::move(errors) : std::make_shared<std::vector<std::string>>()),
        table_(&table),
        file_(std::move(file)),
        name_(std::move(name)),
        schema_(std::move(schema)),
        schemas_{schema_},
        keys_(keys) {}

  /// Whether the key is there; finish() still refuses it unless it is read.
  [[nodiscard]] bool has(const std::string& key) const { return table_->contains(key); }
  /// Whether the key is there; finish() then does not refuse it.
  bool given(const std::string& key) { return find(key, false) != nullptr; }
  /// Reads every key of this table whose entry in the key table names a field; see fields.hpp.
  void read_fields(Scene& scene);
  [[nodiscard]] bool empty() const { return table_->empty(); }  ///< the table has no key
  /// The place of this table, or of `key` if it is there, for errors: FILE:LINE, and every --set in it.
  [[nodiscard]] std::string where() const;
  [[nodiscard]] std::string where(const std::string& key) const;
  /// The place of `key`, with every --set in it or in `others`: keys on which the message depends as well.
  [[nodiscard]] std::string where(const std::string& key, const std::vector<std::string>& others) const;

  double number(const std::string& key);                             ///< reads a number
  std::optional<double> optional_number(const std::string& key);     ///< reads a number; none: absent
  int integer(const std::string& key);                               ///< reads an integer
  bool boolean(const std::string& key);                              ///< reads true or false
  std::string text(const std::string& key);                          ///< reads a string
  std::optional<std::string> optional_text(const std::string& key);  ///< reads a string; none: absent
  /// Reads an enumerator of E by its name; the key's choices must be the names of E.
  template <Named E>
  E choice(const std::string& key) {
    return *from_name<E>(text(key));
  }
  /// Reads an array of numbers whose length is one of `sizes`; where the key's type says so, one number
  /// stands for all. The default is sizes.front() zeros.
  std::vector<double> numbers(const std::string& key, const std::vector<std::size_t>& sizes);
  /// Reads an array as numbers() does. None: the key is absent.
  std::optional<std::vector<double>> optional_numbers(const std::string& key,
                                                      const std::vector<std::size_t>& sizes);
  /// Reads an array of integers whose length is one of `sizes`; integers(): of `size`, without a default.
  std::optional<std::vector<int>> optional_integers(const std::string& key,
                                                    const std::vector<std::size_t>& sizes);
  std::vector<int> integers(const std::string& key, std::size_t size);
  std::array<double, 2> pair(const std::string& key);  ///< reads [a, b]
  /// Reads an array of `least` or more pairs [a, b]. The default is an empty one.
  std::vector<std::array<double, 2>> pairs(const std::string& key, std::size_t least = 2);
  /// Reads an array of `size` strings "+" or "-" as 1 or -1; the key must be without a default.
  std::vector<int> signs(const std::string& key, std::size_t size);
  /// Reads { position, angle } into [position, angle]; a number stands for both.
  std::array<double, 2> per_kind(const std::string& key);
  /// Whether the key is given as a table.
  [[nodiscard]] bool is_table(const std::string& key) const { return (*table_)[key].is_table(); }
  /// Whether the key is given as the text `word`; false where it is absent or of another type.
  bool is_word(const std::string& key, const std::string& word);
  /// Reads one number (a vector of 1) or [lower, upper] (of 2, order not checked). None: the key is absent.
  std::optional<std::vector<double>> number_or_pair(const std::string& key);
  /// Reads an array of `count` numbers; one number stands for all of them.
  std::vector<double> each(const std::string& key, std::size_t count);

  /// Returns the sub-table `key`, to be read under this schema + "." + key. None: the key is absent;
  /// required_section() then throws InputError.
  std::optional<Section> section(const std::string& key);
  Section required_section(const std::string& key);
  /// Returns the sub-table `key`, or an empty table where the key is absent.
  Section section_or_empty(const std::string& key);
  /// Returns the tables of the array `key`, to be read under `schema` (default: this schema + "." + key).
  std::vector<Section> sections(const std::string& key, const std::string& schema = "");

  /// Sets the prefix ("reference[circle]") of the keys read from here on in the key table.
  void use_schema(const std::string& schema) {
    schema_ = schema;
    schemas_.push_back(schema);
  }
  /// Throws InputError when the table holds a key that was not read.
  void finish() const;

  /// Errors so far, of all sections of the root: values that the key table does not allow, keys that are
  /// unknown or missing. Reading goes on with a stand-in; the caller must not use the result.
  [[nodiscard]] const std::vector<std::string>& errors() const { return *errors_; }
  /// Throws InputErrors if the file has errors (errors()), one line each; above 20 the first 19, then a line
  /// with the number of the others.
  void throw_errors() const;

  /// Throws InputError "FILE:LINE: 'section.key' what"; with an empty key: "FILE:LINE: what". `what` is
  /// formatted with the values.
  template <class... T>
  [[noreturn]] void fail(const std::string& key, fmt::format_string<T...> what, T&&... values) const {
    throw InputError(where(key), (key.empty() ? "" : "'" + full(key) + "' ") +
                                     fmt::format(what, std::forward<T>(values)...));
  }

 private:
  /// Null: the key is not given. Throws where it is missing and `required`.
  const toml::node* find(const std::string& key, bool required);
  /// The same, of a key that is required where it has no default.
  const toml::node* find(const std::string& key) { return find(key, spec(key).fallback.empty()); }
  /// An array of a length that `sizes` has; null: not given. `of`: plural of what is in it.
  const toml::array* list(const std::string& key, const toml::node* node,
                          const std::vector<std::size_t>& sizes, const char* of) const;
  [[nodiscard]] std::string path(const std::string& key) const {
    return schema_.empty() ? key : schema_ + "." + key;
  }
  [[nodiscard]] const Key& spec(const std::string& key) const { return find_key(path(key), keys_); }
  [[nodiscard]] std::string full(const std::string& key) const {
    return name_.empty() ? key : name_ + "." + key;
  }
  double checked(const toml::node& node, const std::string& key) const;
  /// Notes keys of the table that the key table does not have here; false: there are none.
  bool reject_misspelt() const;
  void reject(const std::string& key, const std::vector<std::string>& known) const;
  void wrong(const toml::node& node, const std::string& key, const std::string& instead = "") const;
  /// Adds an error that is not yet there.
  void note(const std::string& where, const std::string& what) const;

  std::shared_ptr<std::vector<std::string>> errors_;
  mutable bool unsure_ = false;  ///< a wrong choice: which keys belong here is not known
  const toml::table* table_;
  std::string file_, name_, schema_;
  std::vector<std::string> schemas_;  ///< all that were in use
  std::span<const Key> keys_;
  std::set<std::string> asked_;
};

/// Calls read(), then throws InputErrors if the file of `root` has errors(); else what read() itself threw.
template <class F>
void read_whole(const Section& root, F&& read) {
  try {
    read();
  } catch (const InputError&) {
    root.throw_errors();
    throw;
  }
  root.throw_errors();
}

// Readers of the sections of a scene into `scene`, in the order of their calls: each needs those before, and
// [mechanism] and [control]. All throw InputError.
void read_uncertainty(Section s, Scene& scene);  ///< reads [uncertainty]
void read_reference(Section s, Scene& scene);    ///< reads [reference]
/// [reference] type = "program": its own keys and the moves.
void read_program(Section& s, Scene& scene);
/// Adds to a program the start of the scene and the effects that it is planned with.
void complete_program(Scene& scene);
void read_drives(Section s, Scene& scene);  ///< reads [drives]
/// Reads passive encoders, which follow the motors in the lists of nodes. `given` is [sensors], `root` its
/// table.
void read_sensors(const std::optional<Section>& given, Section& root, Scene& scene);
void read_command(Section s, Scene& scene);      ///< reads [command]
void read_effects(Section& root, Scene& scene);  ///< reads every [[effects]]

}  // namespace esmc::host
