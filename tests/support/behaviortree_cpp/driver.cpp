// Runs behavior trees on BehaviorTree.CPP with scripted leaves, and writes what each tick did.
//
// Standard input has one tree per line, a JSON object; standard output has one trace per line:
//
//   {"xml": text, "ticks": 20, "step_ms": 100, "abort": -1,
//    "telemetry": {"LINK_UP": [1, 0, ...]}, "corrections": ["IfThenElse", ...],
//    "halt_tree": false}
//   {"ticks": [{"result": "R", "status": "RSI", "cells": [[0, "x", 1.5]], "leaves": [["+", 2]]}],
//    "error": "", "bounded": false}
//
// `status` has one letter per node, parents before children. `cells` are the entries of the
// blackboards that have changed: number of the subtree, name, value. `leaves` are the starts (+)
// and halts (-) of leaves by the number of their node. The name of a leaf is its script; see
// README.md.
#include <cmath>
#include <iostream>
#include <limits>
#include <map>
#include <set>
#include <sstream>

#include "behaviortree_cpp/bt_factory.h"
#include "behaviortree_cpp/contrib/json.hpp"
#include "behaviortree_cpp/controls/if_then_else_node.h"
#include "behaviortree_cpp/controls/while_do_else_node.h"

using namespace BT;
using nlohmann::json;

namespace
{
constexpr int MAX_EXECUTIONS = 50;  // of the root in one tick

json* events = nullptr;
std::map<const TreeNode*, int> numbers;

void note(const char* what, const TreeNode& node)
{
  if(events != nullptr)
  {
    events->push_back({ what, numbers.at(&node) });
  }
}

std::vector<std::string> script_of(const std::string& name)
{
  std::istringstream words(name);
  std::vector<std::string> script;
  std::string word;
  words >> word;  // the first names the leaf
  while(words >> word)
  {
    script.push_back(word);
  }
  return script;
}

NodeStatus status_of(char letter)
{
  switch(letter)
  {
    case 'S':
      return NodeStatus::SUCCESS;
    case 'F':
      return NodeStatus::FAILURE;
    default:
      return NodeStatus::RUNNING;
  }
}

char letter_of(NodeStatus status)
{
  return std::string("IRSFK").at(static_cast<size_t>(status));
}

// A command: each start plays the next word of its script, one letter per tick; the last repeats.
class ScriptedCommand : public StatefulActionNode
{
public:
  ScriptedCommand(const std::string& name, const NodeConfig& config)
    : StatefulActionNode(name, config), script_(script_of(name))
  {}

  NodeStatus onStart() override
  {
    word_ = script_[starts_++ % script_.size()];
    at_ = 0;
    note("+", *this);
    for(const char* port : { "pan", "tilt" })
    {
      if(config().input_ports.count(port) != 0)
      {
        const auto value = getInput<double>(port);
        if(!value)
        {
          throw RuntimeError(value.error());
        }
        events->back().push_back(value.value());
      }
    }
    return onRunning();
  }

  NodeStatus onRunning() override
  {
    const char letter = word_[std::min(at_, word_.size() - 1)];
    at_++;
    return status_of(letter);
  }

  void onHalted() override
  {
    note("-", *this);
  }

private:
  std::vector<std::string> script_;
  std::string word_;
  size_t starts_ = 0;
  size_t at_ = 0;
};

class Picture : public ScriptedCommand
{
public:
  using ScriptedCommand::ScriptedCommand;
  static PortsList providedPorts()
  {
    return { InputPort<double>("deadline_s") };
  }
};

class CameraAngles : public ScriptedCommand
{
public:
  using ScriptedCommand::ScriptedCommand;
  static PortsList providedPorts()
  {
    return { InputPort<double>("deadline_s"), InputPort<double>("pan"),
             InputPort<double>("tilt") };
  }
};

// A condition: one letter per tick, from the first again after the last.
class ScriptedCondition : public ConditionNode
{
public:
  ScriptedCondition(const std::string& name, const NodeConfig& config)
    : ConditionNode(name, config), word_(script_of(name).front())
  {}

  static PortsList providedPorts()
  {
    return { InputPort<double>("x"), InputPort<double>("y"), InputPort<double>("within") };
  }

  NodeStatus tick() override
  {
    return status_of(word_[asked_++ % word_.size()]);
  }

private:
  std::string word_;
  size_t asked_ = 0;
};

// The corrections: each node as the library has it but for one fault.

// Resets its condition after a failure without `else`; a skipped condition skips it.
class CorrectedIfThenElse : public IfThenElseNode
{
public:
  using IfThenElseNode::IfThenElseNode;

  void halt() override
  {
    branch_ = 0;
    ControlNode::halt();
  }

private:
  size_t branch_ = 0;

  NodeStatus tick() override
  {
    setStatus(NodeStatus::RUNNING);
    NodeStatus answer = NodeStatus::RUNNING;
    if(branch_ == 0)
    {
      answer = children_nodes_[0]->executeTick();
      if(answer == NodeStatus::SUCCESS)
      {
        branch_ = 1;
      }
      else if(answer == NodeStatus::FAILURE && childrenCount() == 3)
      {
        branch_ = 2;
      }
    }
    if(branch_ != 0)
    {
      answer = children_nodes_[branch_]->executeTick();
    }
    if(answer != NodeStatus::RUNNING)
    {
      resetChildren();
      branch_ = 0;
    }
    return answer;
  }
};

// A skipped condition skips it.
class CorrectedWhileDoElse : public WhileDoElseNode
{
public:
  using WhileDoElseNode::WhileDoElseNode;

private:
  NodeStatus tick() override
  {
    setStatus(NodeStatus::RUNNING);
    NodeStatus answer = children_nodes_[0]->executeTick();
    if(answer == NodeStatus::RUNNING)
    {
      return answer;
    }
    const size_t branch = answer == NodeStatus::SUCCESS ? 1 : 2;
    if(answer != NodeStatus::SKIPPED && branch < childrenCount())
    {
      if(childrenCount() == 3)
      {
        haltChild(3 - branch);
      }
      answer = children_nodes_[branch]->executeTick();
    }
    if(answer != NodeStatus::RUNNING)
    {
      resetChildren();
    }
    return answer;
  }
};

// Evaluates its condition again after a halt.
class CorrectedPrecondition : public DecoratorNode
{
public:
  CorrectedPrecondition(const std::string& name, const NodeConfig& config)
    : DecoratorNode(name, config)
  {
    std::string script;
    getInput("if", script);
    condition_ = ParseScript(script).value();
  }

  static PortsList providedPorts()
  {
    return { InputPort<std::string>("if"),
             InputPort<NodeStatus>("else", NodeStatus::FAILURE, "") };
  }

  void halt() override
  {
    inside_ = false;
    DecoratorNode::halt();
  }

private:
  ScriptFunction condition_;
  bool inside_ = false;

  NodeStatus tick() override
  {
    Ast::Environment environment = { config().blackboard, config().enums };
    inside_ = inside_ || condition_(environment).cast<bool>();
    if(!inside_)
    {
      return getInput<NodeStatus>("else").value();
    }
    const NodeStatus answer = child_node_->executeTick();
    if(isStatusCompleted(answer))
    {
      resetChild();
      inside_ = false;
    }
    return answer;
  }
};

// Halts its child in its own tick, not from the thread of the timer.
class CorrectedTimeout : public DecoratorNode
{
public:
  using DecoratorNode::DecoratorNode;

  static PortsList providedPorts()
  {
    return { InputPort<unsigned>("msec") };
  }

  void halt() override
  {
    begun_ = false;
    DecoratorNode::halt();
  }

private:
  bool begun_ = false;
  int64_t due_ms_ = 0;

  NodeStatus tick() override
  {
    const auto limit_ms = static_cast<int64_t>(getInput<unsigned>("msec").value());
    const int64_t now_ms = SimulatedTime::instance().now_ms();
    if(!begun_)
    {
      begun_ = true;
      due_ms_ = now_ms + limit_ms;
      setStatus(NodeStatus::RUNNING);
    }
    const bool expires = begun_ && limit_ms > 0 && now_ms >= due_ms_;
    const bool halts = expires && child()->status() == NodeStatus::RUNNING;
    if(expires && !halts)
    {
      due_ms_ = std::numeric_limits<int64_t>::max();  // the timer fires once
    }
    const NodeStatus answer = halts ? NodeStatus::FAILURE : child()->executeTick();
    if(isStatusCompleted(answer))
    {
      begun_ = false;
      resetChild();
    }
    return answer;
  }
};

// Writes a text into a variable that a script has created, instead of emptying it.
class CorrectedSetBlackboard : public SyncActionNode
{
public:
  using SyncActionNode::SyncActionNode;

  static PortsList providedPorts()
  {
    return { InputPort("value", ""), BidirectionalPort("output_key", "") };
  }

private:
  NodeStatus tick() override
  {
    const auto& blackboard = config().blackboard;
    const auto key = getInput<std::string>("output_key").value();
    const std::string text = config().input_ports.at("value");
    Any value(text);
    StringView source;
    if(isBlackboardPointer(text, &source))
    {
      value = blackboard->getEntry(std::string(source))->value;
    }
    if(!blackboard->getEntry(key))
    {
      blackboard->createEntry(key, PortInfo());
    }
    blackboard->getEntry(key)->value = value;
    return NodeStatus::SUCCESS;
  }
};

// The table of builders is constant to users: registerNodeType refuses a name that exists.
template <class Node>
void replace(BehaviorTreeFactory& factory, const std::string& kind)
{
  using Builders = std::unordered_map<std::string, NodeBuilder>;
  const_cast<Builders&>(factory.builders())[kind] = CreateBuilder<Node>();
}

json value_of(const Any& value)
{
  if(value.isString())
  {
    return value.cast<std::string>();
  }
  const double number = value.cast<double>();
  return std::isfinite(number) ? json(number) : json(std::to_string(number));
}

// The entries that each subtree has itself: those that it shares are listed where they are.
json cells_of(const Tree& tree)
{
  json cells = json::object();
  std::set<const Blackboard::Entry*> seen;
  for(size_t i = 0; i < tree.subtrees.size(); i++)
  {
    const auto& blackboard = tree.subtrees[i]->blackboard;
    for(const auto& key : blackboard->getKeys())
    {
      const std::string name(key);
      const auto entry = blackboard->getEntry(name);
      if(seen.insert(entry.get()).second && !entry->value.empty())
      {
        cells[std::to_string(i) + " " + name] = value_of(entry->value);
      }
    }
  }
  return cells;
}

json changes(const json& before, const json& after)
{
  json changed = json::array();
  for(const auto& [key, value] : after.items())
  {
    if(!before.contains(key) || before.at(key) != value)
    {
      const auto space = key.find(' ');
      changed.push_back({ std::stoi(key.substr(0, space)), key.substr(space + 1), value });
    }
  }
  return changed;
}

json run(const json& request)
{
  json trace = { { "ticks", json::array() }, { "error", "" }, { "bounded", false } };
  json ignored = json::array();
  auto& time = SimulatedTime::instance();
  time.forget_timers();
  try
  {
    BehaviorTreeFactory factory;
    factory.registerNodeType<Picture>("takePicture");
    factory.registerNodeType<CameraAngles>("setCameraAngles");
    factory.registerNodeType<ScriptedCondition>("Near");
    for(const auto& correction : request.value("corrections", json::array()))
    {
      if(correction == "IfThenElse")
      {
        replace<CorrectedIfThenElse>(factory, "IfThenElse");
      }
      else if(correction == "WhileDoElse")
      {
        replace<CorrectedWhileDoElse>(factory, "WhileDoElse");
      }
      else if(correction == "Precondition")
      {
        replace<CorrectedPrecondition>(factory, "Precondition");
      }
      else if(correction == "Timeout")
      {
        replace<CorrectedTimeout>(factory, "Timeout");
      }
      else if(correction == "SetBlackboard")
      {
        replace<CorrectedSetBlackboard>(factory, "SetBlackboard");
      }
    }
    auto blackboard = Blackboard::create();
    const json telemetry = request.value("telemetry", json::object());
    for(const auto& [name, values] : telemetry.items())
    {
      blackboard->set<double>(name, values.at(0).get<double>());
    }
    // The tree is never destroyed: its destructor halts it, and a script that throws there ends
    // the process.
    auto& tree = *new Tree(
        factory.createTreeFromText(request.at("xml").get<std::string>(), blackboard));
    numbers.clear();
    std::vector<TreeNode*> nodes;
    tree.applyVisitor([&](TreeNode* node) {
      numbers[node] = static_cast<int>(nodes.size());
      nodes.push_back(node);
    });
    json cells = json::object();
    const int abort = request.value("abort", -1);
    for(int tick = 0; tick < request.at("ticks").get<int>(); tick++)
    {
      json row = { { "leaves", json::array() } };
      events = &row["leaves"];
      if(tick > 0)
      {
        time.advance(request.at("step_ms").get<int>());
        tree.sleep(std::chrono::milliseconds(0));  // takes the wake-ups of the timers
      }
      for(const auto& [name, values] : telemetry.items())
      {
        const size_t at = std::min<size_t>(static_cast<size_t>(tick), values.size() - 1);
        blackboard->set<double>(name, values.at(at).get<double>());
      }
      std::string result = "H";
      if(tick == abort)
      {
        if(request.value("halt_tree", false))
        {
          tree.haltTree();
        }
        else
        {
          tree.rootNode()->haltNode();
        }
      }
      else
      {
        int executions = 1;
        NodeStatus status = tree.tickExactlyOnce();
        while(status == NodeStatus::RUNNING && executions < MAX_EXECUTIONS &&
              tree.wakeUpSignal()->waitFor(std::chrono::microseconds(0)))
        {
          status = tree.tickExactlyOnce();
          executions++;
        }
        trace["bounded"] = trace["bounded"].get<bool>() || executions == MAX_EXECUTIONS;
        result = std::string(1, letter_of(status));
      }
      std::string statuses;
      for(const auto* node : nodes)
      {
        statuses += letter_of(node->status());
      }
      const json now = cells_of(tree);
      row["result"] = result;
      row["status"] = statuses;
      row["cells"] = changes(cells, now);
      cells = now;
      trace["ticks"].push_back(row);
      if(result != "R")
      {
        break;
      }
    }
    events = &ignored;
  }
  catch(const std::exception& error)
  {
    trace["error"] = error.what();
  }
  events = nullptr;
  return trace;
}
}  // namespace

int main()
{
  std::string line;
  while(std::getline(std::cin, line))
  {
    std::cout << run(json::parse(line)).dump() << "\n";
  }
}
